#!/bin/sh
# setup.sh VENV [BPY]: make the virtual environment VENV with everything Fresco, its demo and its tests need,
# with Blender's module in version BPY (default: the one pyproject.toml names for the Python in use).
# Wants Python 3.11 or 3.13 (PYTHON=... to choose): the versions for which Blender's module `bpy` exists.
set -eu
venv=$1 bpy=${2:-}

usable() { "$1" -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 13)))' 2>/dev/null; }
find_python() {
    for python in ${PYTHON:-} python3.11 python3.13 python3 python; do
        if usable "$python"; then echo "$python"; return; fi
    done
    echo "Fresco needs Python 3.11 or 3.13 (Blender's own); none was found. Name one: make PYTHON=/path/to/python" >&2
    exit 2
}
make_venv() {
    "$1" -m venv "$venv" 2>/dev/null && return
    echo "$1 cannot make virtual environments; on Debian or Ubuntu: apt-get install python3-venv" >&2
    exit 2
}
# A bare server lacks the few X and GL libraries that Blender links to, even without a window.
blender_libraries() {
    "$venv/bin/python" -c 'import bpy' 2>/dev/null && return
    packages="libegl1 libgl1 libice6 libsm6 libx11-6 libxext6 libxfixes3 libxi6 libxkbcommon0 libxrender1 libxxf86vm1"
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        apt-get update -qq
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $packages
    fi
    "$venv/bin/python" -c 'import bpy' && return
    echo "Blender's module does not load: system libraries are missing. Debian, Ubuntu: apt-get install $packages" >&2
    exit 2
}

python=$(find_python)
echo "Setting up $venv with $("$python" --version)"
make_venv "$python"
export PIP_DISABLE_PIP_VERSION_CHECK=1
"$venv/bin/python" -m pip install -q --upgrade pip
"$venv/bin/python" -m pip install -q --prefer-binary -e ".[bpy,dev]"
[ -z "$bpy" ] || "$venv/bin/python" -m pip install -q "bpy==$bpy"
blender_libraries
touch "$venv/.ready"
