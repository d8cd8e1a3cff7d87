# shellcheck shell=bash
# The environment of the workspace, for bash: . scripts/environment.sh
# One place for ./run, the Makefile and the tests. Needs `make setup` once.

# Without CDPATH, with which cd prints where it went, and without what a shell of the user's calls cd and dirname.
fin_root=$(CDPATH='' builtin cd -- "$(command dirname -- "${BASH_SOURCE[0]}")/.." && builtin pwd)
if [[ ! -f "$fin_root/.venv/.mode" || ! -f "$fin_root/ros2_ws/install/setup.bash" ]]; then
    echo "environment.sh: error: the workspace is not set up: run 'make setup' in $fin_root" >&2
    return 1
fi

# The set-up files of ROS and colcon read variables that may not be set.
fin_options=$(set +o)
set +u
read -r fin_mode <"$fin_root/.venv/.mode"
if [[ $fin_mode == wheels ]]; then
    # The ROS wheels set LD_LIBRARY_PATH once, on the first start of Python; what another environment's wheels
    # left behind must not count as done.
    if [[ :$LD_LIBRARY_PATH: != *":$fin_root/.venv/"* ]]; then
        unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
    fi
elif [[ :$AMENT_PREFIX_PATH: != *":$fin_mode:"* ]]; then
    # shellcheck disable=SC1091
    . "$fin_mode/setup.bash"
fi
# What would have Python look for itself elsewhere, or ask for commands at its end.
unset PYTHONHOME PYTHONPLATLIBDIR PYTHONINSPECT
export VIRTUAL_ENV="$fin_root/.venv"
case :$PATH: in
*":$VIRTUAL_ENV/bin:"*) ;;
*) export PATH="$VIRTUAL_ENV/bin:$PATH" ;;
esac
# Its packages come before others of the same name that PYTHONPATH may hold.
if [[ :$AMENT_PREFIX_PATH: != *":$fin_root/ros2_ws/install/fin_plant:"* || $PYTHONPATH != "$fin_root/ros2_ws/"* ]]; then
    # shellcheck disable=SC1091
    . "$fin_root/ros2_ws/install/setup.bash"
fi

# Quick discovery and acknowledgement for the command line too, on this machine only unless the user has said otherwise:
# the rule of `discovery` in fin_plant/ros_environment.py, by which the nodes set it themselves.
fin_profiles=$fin_root/ros2_ws/src/fin_plant/fin_plant
fin_reach=$ROS_AUTOMATIC_DISCOVERY_RANGE$ROS_STATIC_PEERS$ROS_LOCALHOST_ONLY$ROS_DISCOVERY_SERVER
fin_reach+=$FASTDDS_DEFAULT_PROFILES_FILE$FASTDDS_ENVIRONMENT_FILE
if [[ -z $FASTRTPS_DEFAULT_PROFILES_FILE && ${RMW_IMPLEMENTATION:-fastrtps} == *fastrtps* &&
    ! -e DEFAULT_FASTRTPS_PROFILES.xml && ! -e DEFAULT_FASTDDS_PROFILES.xml ]]; then
    if [[ -n $fin_reach ]]; then
        export FASTRTPS_DEFAULT_PROFILES_FILE=$fin_profiles/fast_dds_profile.xml
    else
        export FASTRTPS_DEFAULT_PROFILES_FILE=$fin_profiles/fast_dds_localhost_profile.xml
        export ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT
    fi
fi

eval "$fin_options"
unset fin_root fin_mode fin_options fin_profiles fin_reach
