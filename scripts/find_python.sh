#!/usr/bin/env -S bash -p
# Prints the path of a Python that can run the workspace without a ROS installation; exits 1 if there is none.
# The pinned ROS wheels exist for 3.11 to 3.13; 3.12 is what ROS 2 Jazzy itself uses, so it comes first.
set -euo pipefail

# True if $1 really starts (a pyenv shim may not), is version $2, and can make a virtual environment.
usable() {
    "$1" -c "import ensurepip, sys, venv; sys.exit('%d.%d' % sys.version_info[:2] != '$2')" >/dev/null 2>&1
}

candidates() {
    local version=$1
    type -P "python$version" || true
    type -P python3 || true
    if type -P pyenv >/dev/null; then
        find "$(pyenv root)/versions" -maxdepth 3 -path "*/$version.*/bin/python" 2>/dev/null | sort -rV || true
    fi
    if type -P uv >/dev/null; then
        uv python find --no-python-downloads "$version" 2>/dev/null || true
    fi
}

for version in 3.12 3.11 3.13; do
    while read -r python; do
        if usable "$python" "$version"; then
            # The real interpreter: not a shim whose answer depends on the directory, nor that of an activated
            # environment, which may be the very one that is about to be made.
            exec "$python" -c 'import os, sys; print(os.path.realpath(getattr(sys, "_base_executable", sys.executable)))'
        fi
    done < <(candidates "$version")
done
exit 1
