from hypothesis import settings

# Examples are the same in every run, and a slow machine is no failure.
settings.register_profile("fresco", deadline=None, derandomize=True)
settings.load_profile("fresco")
