import sys
from pathlib import Path

# The scenes that several tests here share; importlib mode does not put the folder on the path.
sys.path.insert(0, str(Path(__file__).parent))
