#!/usr/bin/env -S bash -p
# Draws docs/figures/report.png, the top of a study's report as Chromium shows it:
#   make demo ARGS="study_folder:=runs/demo" && scripts/draw_report.sh runs/demo
set -euo pipefail
root=$(CDPATH='' cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
study=${1:?which study? Give its folder}
browser=$(type -P chromium || type -P chromium-browser) || {
    echo "draw_report.sh: error: there is no chromium here: apt-get install chromium" >&2
    exit 1
}
"$root/run" fin_optimizer report "$study"
page=$(realpath -- "$study/report.html")
profile=$(mktemp -d)
trap 'rm -rf -- "$profile"' EXIT
# Time runs ahead until all is drawn, the same on a slow machine.
"$browser" --headless --no-sandbox --disable-gpu --hide-scrollbars --force-prefers-reduced-motion \
    --user-data-dir="$profile" --virtual-time-budget=20000 --window-size=1100,1330 \
    --screenshot="$root/docs/figures/report.png" "file://$page"
