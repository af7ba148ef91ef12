#!/usr/bin/env bash
# Nodes that are not ours against nodes that are: the Python robot and the Python watcher of examples/python finish a
# trial with Tandem's own operator, arbiter and predictor, in lockstep and in real time.
#
#     checks/python_nodes.sh FOLDER          FOLDER as for readers.sh; TANDEM names our program
#
# Exit code 0: the goal was reached in both, in lockstep with one press. 1: not. 4: the package `eclipse-zenoh` cannot be had.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
tandem="${TANDEM:-tandem}"
python="$1/bin/python"

"$here/readers.sh" "$1" || exit 4
logs="$(mktemp -d)"
started=()
end() {
    for process in "${started[@]}"; do kill -TERM "$process" 2>/dev/null || true; done
    for process in "${started[@]}"; do wait "$process" 2>/dev/null || true; done
    started=()
}
trap 'end; rm -rf "$logs"' EXIT
start() { "${@:2}" > "$logs/$1" 2>&1 & started+=($!); }

for pace in max real; do
    port="$("$python" -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')"
    at=(--robot python --connect "tcp/127.0.0.1:$port")
    lockstep=(); [ "$pace" = real ] || lockstep=(--lockstep)
    start robot "$python" "$here/../examples/python/point_robot.py" --robot python --listen "tcp/127.0.0.1:$port" "${lockstep[@]}"
    # In lockstep the scene is said once, at the trial's beginning: the watcher is there before the operator begins it.
    "$python" "$here/../examples/python/watch_robot.py" "${at[@]}" --until-goal 60 --json > "$logs/summary" 2> "$logs/watch" &
    watching=$!
    started+=("$watching")
    for node in predictor arbiter; do start "$node" "$tandem" "$node" "${at[@]}" --set "loop.pace=$pace"; done
    until grep -q watching "$logs/watch" || ! kill -0 "$watching" 2>/dev/null; do sleep 0.1; done
    start operator "$tandem" operator "${at[@]}" --set "loop.pace=$pace"
    if ! wait "$watching"; then
        echo "the Python robot did not reach the goal (loop.pace = $pace)"; tail -n 5 "$logs"/*; exit 1
    fi
    # In real time a machine that is busy may stop it in between, and rightly.
    [ "$pace" = real ] || grep -q '"presses": 1' "$logs/summary" || { echo "it took more than one press (loop.pace = $pace)"; cat "$logs/summary"; exit 1; }
    echo "loop.pace = $pace: $(cat "$logs/summary")"
    end
done
