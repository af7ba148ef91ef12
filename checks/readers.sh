#!/usr/bin/env bash
# A Python environment in FOLDER with the readers of checks/requirements.txt, made once.
#
#     checks/readers.sh FOLDER            makes it; fails with a sentence if that cannot be done
#     checks/readers.sh FOLDER rerun      prints where the program `rerun` is
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
folder="$1"

# The package's own `rerun` is a script that starts Python first; this is the program behind it.
find_rerun() { find "$folder" -path '*rerun_cli/rerun*' -type f -perm -u+x 2>/dev/null | head -n 1; }

if [ "${2:-}" = rerun ]; then
    find_rerun
    exit
fi
if cmp -s "$here/requirements.txt" "$folder/made-from.txt"; then exit 0; fi
command -v python3 >/dev/null || { echo "python3 is not there"; exit 1; }
python3 -m venv --clear "$folder" >/dev/null 2>&1 || { echo "python3 cannot make a virtual environment (python3-venv)"; exit 1; }
"$folder/bin/pip" install --quiet --disable-pip-version-check --retries 1 --timeout 20 -r "$here/requirements.txt" \
    || { echo "the readers cannot be installed: no network, or not these versions"; exit 1; }
[ -n "$(find_rerun)" ] || { echo "the package rerun-sdk brought no program"; exit 1; }
"$(find_rerun)" analytics disable >/dev/null 2>&1 || true
cp "$here/requirements.txt" "$folder/made-from.txt"
