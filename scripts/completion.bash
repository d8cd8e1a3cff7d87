# Completion of ./run in bash: . scripts/completion.bash
# Packages, then their executables, then files; both are read from the installed workspace, so it is never out of date.
_fin_run() {
    local install words
    install=$(dirname "$(readlink -f "${COMP_WORDS[0]}")")/ros2_ws/install
    case $COMP_CWORD in
    1) words=$(cd "$install" 2>/dev/null && find . -mindepth 3 -maxdepth 3 -path './*/lib/*' -printf '%f\n' | sort -u) ;;
    2) words=$(ls "$install/${COMP_WORDS[1]}/lib/${COMP_WORDS[1]}" 2>/dev/null) ;;
    *) return ;;
    esac
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "${COMP_WORDS[COMP_CWORD]}")
}
complete -o default -F _fin_run ./run
