#!/usr/bin/env bash
# Recorded sessions, opened by software that we did not write.
#
#     checks/third_party.sh FOLDER SESSION.mcap…     beside each: SESSION.rrd
#
# FOLDER keeps a Python environment with the readers (made the first time, from the network). TANDEM names our program.
# For a session that has a SESSION.json, the summary of `tandem demo --pace max --json`, the values are compared too.
# Exit code 0: all agree. 1: something differs. 4: the readers are not there and cannot be had.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
folder="$1"; shift
tandem="${TANDEM:-tandem}"

"$here/readers.sh" "$folder" || exit 4
rerun="$("$here/readers.sh" "$folder" rerun)"

for session in "$@"; do
    echo "-- $session"
    "$rerun" mcap check --full "$session" > "$session.check" 2>&1 || { cat "$session.check"; exit 1; }
    if grep -E '^(warn|error|fail)' "$session.check"; then exit 1; fi
    echo "rerun mcap check --full: $(grep -c '^ok' "$session.check") channels ok"
    "$rerun" rrd verify "${session%.mcap}.rrd"
    if [ -e "${session%.mcap}.json" ]; then
        "$tandem" session info --json "$session" > "$session.info.json"
        "$folder/bin/python" "$here/read_session.py" "$session" "$session.info.json" "${session%.mcap}.json"
    fi
done
