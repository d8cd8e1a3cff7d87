#!/usr/bin/env -S bash -p
# Prepares everything: a virtual environment with pinned packages, and the workspace built into it.
# Does nothing where nothing has changed, and may be called from several shells at once.
set -euo pipefail

unset CDPATH # with it cd prints where it went
# What is made here must not come from, or go to, where the user's other projects are.
unset PYTHONHOME PYTHONPATH PYTHONPLATLIBDIR PYTHONINSPECT PYTHONOPTIMIZE PYTHONSAFEPATH PYTHONWARNINGS
unset PIP_PREFIX PIP_REQUIRE_VIRTUALENV PIP_ROOT PIP_TARGET PIP_USER
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
venv=$root/.venv
log=$root/.setup.log
ros_prefix=${FIN_ROS_PREFIX:-/opt/ros/jazzy}

say() { echo "setup: $*"; }

fail() {
    printf 'setup: error: %s\n' "$@" >&2
    exit 1
}

# step "what" command...: runs it quietly and says how long it took; its output is shown only if it fails.
step() {
    local what=$1 start=$SECONDS status
    shift
    printf 'setup: %s ... ' "$what"
    # Not `if ! "$@"`: bash would ignore every failure inside the function but the last one.
    set +e
    (set -e && "$@") >"$log" 2>&1
    status=$?
    set -e
    if ((status != 0)); then
        echo "failed"
        # Notes about package folders that are not there hide the error.
        grep -v "^WARNING: Location" "$log" | tail -n 40 >&2 || true
        fail "$what failed; the end of its output is above, all of it in $log"
    fi
    echo "$((SECONDS - start)) s"
}

digest() { sha256sum | cut -d ' ' -f 1; }

# ---------------------------------------------------------------------------------------------------------------
# What to build on: an installed ROS 2 Jazzy, else a Python that the ROS wheels exist for.
choose() {
    if [[ -n ${ROS_DISTRO:-} && $ROS_DISTRO != jazzy ]]; then
        fail "this shell has ROS 2 $ROS_DISTRO sourced; the workspace is for ROS 2 Jazzy. Use a new shell."
    fi
    if [[ -f $ros_prefix/setup.bash ]]; then
        mode=$ros_prefix
        # The message types are compiled for one Python, and no other can load them.
        local library
        library=$(find "$ros_prefix/lib" -maxdepth 1 -name 'python3.*' | head -n 1)
        python=$(type -P "/usr/bin/$(basename "$library")" || true)
        if [[ -z $library || -z $python ]]; then
            fail "$ros_prefix has no Python 3 library, or its Python is not in /usr/bin"
        fi
        if ! "$python" -c "import ensurepip, venv" 2>/dev/null; then
            fail "$python cannot make virtual environments" "to get that: sudo apt install python3-venv"
        fi
        requirements=(requirements/run.txt requirements/build.txt requirements/dev.txt)
        return
    fi
    mode=wheels
    requirements=(requirements/ros.txt requirements/run.txt requirements/build.txt requirements/dev.txt)
    if [[ $(uname -s)-$(uname -m) != Linux-x86_64 ]]; then
        fail "no ROS 2 Jazzy in $ros_prefix, and its Python wheels exist for Linux on x86-64 only," \
            "this is $(uname -s) on $(uname -m)" "install ROS 2 Jazzy (https://docs.ros.org/en/jazzy/Installation.html)"
    fi
    if ! python=$(scripts/find_python.sh); then
        fail "no ROS 2 Jazzy in $ros_prefix, and no usable Python 3.12, 3.11 or 3.13 (with its venv module) either" \
            "get one of them, then run this again:" \
            "  Ubuntu 24.04:  sudo apt install python3-venv" \
            "  Debian 12:     sudo apt install python3-venv" \
            "  pyenv:         pyenv install 3.12" \
            "  uv:            uv python install 3.12" \
            "  or ROS 2 Jazzy: https://docs.ros.org/en/jazzy/Installation.html"
    fi
}

make_venv() {
    local options=()
    if [[ $mode != wheels ]]; then
        options=(--system-site-packages)
    fi
    rm -rf "$venv"
    "$python" -m venv "${options[@]}" "$venv"
    echo "$mode" >"$venv/.mode"
    # Nothing else in the repository should pick the environment up, colcon and git least of all.
    touch "$venv/COLCON_IGNORE"
    echo '*' >"$venv/.gitignore"
}

install_packages() {
    local files=() file
    for file in "${requirements[@]}"; do
        files+=(-r "$file")
    done
    "$venv/bin/python" -m pip install --disable-pip-version-check --no-input "${files[@]}"
}

import_ros() {
    if [[ $mode != wheels ]]; then
        set +u
        # shellcheck disable=SC1091
        . "$mode/setup.bash"
        set -u
    fi
    "$venv/bin/python" -c "import numba, rclpy, std_msgs.msg"
}

prepare_packages() {
    local wanted
    wanted=$({ echo "$root $mode $python" && cat "${requirements[@]}"; } | digest)
    if [[ -f $venv/.installed && $(<"$venv/.installed") == "$wanted" ]]; then
        return
    fi
    local what
    what="$(cat "${requirements[@]}" | grep -vcE '^(#|$)') pinned packages"
    # In place only on top of a complete installation for the same Python, else from scratch.
    if [[ -f $venv/.installed && -f $venv/.base && $(<"$venv/.base") == "$root $mode $python" ]]; then
        what="bringing $what up to date"
    else
        what="installing $what (about 350 MB to download, a minute or two)"
        step "virtual environment for $("$python" --version)" make_venv
    fi
    rm -f "$venv/.installed"
    step "$what" install_packages
    step "checking that rclpy starts" import_ros
    echo "$root $mode $python" >"$venv/.base"
    echo "$wanted" >"$venv/.installed"
}

# ---------------------------------------------------------------------------------------------------------------
# The workspace. Links lead from the installation to the sources, so an edit takes effect without a build; what
# needs one is in this list.
built_from() {
    echo "$root" "$(<"$venv/.installed")"
    declare -f build start_quietly
    find ros2_ws/src -maxdepth 2 \( -name package.xml -o -name setup.py -o -name setup.cfg \) | sort | xargs cat
    find ros2_ws/src -mindepth 2 \( -path '*/config/*' -o -path '*/launch/*' -o -path '*/resource/*' \) -type f ! -path '*/__pycache__/*' | sort
    find ros2_ws/src -mindepth 2 -maxdepth 2 -type d ! -name __pycache__ | sort
}

build() {
    if [[ $mode != wheels ]]; then
        set +u
        # shellcheck disable=SC1091
        . "$mode/setup.bash"
        set -u
    fi
    unset COLCON_PREFIX_PATH
    cd "$root/ros2_ws"
    local marker=build/.started
    mkdir -p build
    touch "$marker"
    # Links to sources that are gone: setup.py would find them and fail.
    find build -xtype l -delete
    "$venv/bin/python" -m colcon build --symlink-install
    # What an earlier build installed and this one did not.
    find install -mindepth 4 -maxdepth 4 -path 'install/*/lib/*' -type f -executable ! -newer "$marker" -delete
    find install -xtype l -delete
    # colcon's scripts split a path at its spaces.
    # shellcheck disable=SC2016
    sed -i 's|\$(\$_colcon_python_executable |$("$_colcon_python_executable" |' install/local_setup.*sh
    start_quietly
}

# Makes fin_plant/start.py what starts the executables, with SIGINT held back until it listens. `env -S` reads the
# quotes that a path may need.
start_quietly() {
    local held='' first file
    if env --block-signal=INT true 2>/dev/null; then
        held=" --block-signal=INT"
    fi
    first="#!/usr/bin/env -S$held \"$venv/bin/python\" -P -m fin_plant.start"
    if (($(printf '%s\n' "$first" | wc -c) > 255)); then
        echo "the path $root is too long for the first line of a script, which Linux reads 255 bytes of: move it" >&2
        return 1
    fi
    while IFS= read -r -d '' file; do
        { printf '%s\n' "$first" && sed 1d "$file"; } >build/.executable
        cat build/.executable >"$file"
    done < <(find install -mindepth 4 -maxdepth 4 -path 'install/*/lib/*' -type f -executable -print0)
}

prepare_workspace() {
    local wanted
    wanted=$(built_from | digest)
    if [[ -f ros2_ws/install/.built && $(<ros2_ws/install/.built) == "$wanted" ]]; then
        return
    fi
    rm -f ros2_ws/install/.built
    step "building the workspace" build
    echo "$wanted" >ros2_ws/install/.built
}

# ---------------------------------------------------------------------------------------------------------------
# What would be compiled at the first start, and at every start where PYTHONDONTWRITEBYTECODE keeps Python from keeping
# it. What does not compile says so when it is used.
compile_code() {
    # shellcheck disable=SC1091
    . scripts/environment.sh
    unset PYTHONDONTWRITEBYTECODE
    python -m compileall -qq ros2_ws/src/*/fin_* || true
    if [[ $1 == everything ]]; then
        # The tests' modules, as pytest rewrites them; beside the kernels, which take one core as well.
        python -m pytest --collect-only -qq >/dev/null 2>&1 &
        python -m fin_sim.compile_all || true
        wait
    fi
}

prepare_code() {
    local wanted
    wanted=$({ cat ros2_ws/install/.built && find ros2_ws/src/fin_sim -name '*.py' -printf '%p %s %T@\n' | sort; } | digest)
    if [[ -f ros2_ws/install/.compiled && $(<ros2_ws/install/.compiled) == "$wanted" ]]; then
        (compile_code sources)
        return
    fi
    step "compiling the simulator's kernels" compile_code everything
    echo "$wanted" >ros2_ws/install/.compiled
}

# ---------------------------------------------------------------------------------------------------------------
if [[ $root == *[\"\$\`\\:]* || $root == *$'\n'* ]]; then
    fail "the path $root has a character that the scripts of pip and colcon cannot take:" \
        'one of " $ ` \ : or a line break. Rename the folder, or set up in another one'
fi
type -P flock >/dev/null || fail "the command flock is missing" "to get it: sudo apt install util-linux"
# Runs when the command under way has ended, which Ctrl-C reaches too.
trap 'printf "\nsetup: interrupted; run it again to go on\n" >&2; exit 130' INT
exec 9>"$root/.setup.lock"
if ! flock -n 9; then
    say "another set-up is under way here; waiting for it"
    flock 9
fi

choose
prepare_packages
prepare_workspace
prepare_code
say "ready ($([[ $mode == wheels ]] && echo "ROS 2 Jazzy wheels" || echo "$mode"), $("$python" --version))"
