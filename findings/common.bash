# Sourced by every finding: a virtual environment of its own in a temporary folder, removed at exit.
# PYTHON names the interpreter (3.11 or newer). Exit codes of a finding: 0 as described, 1 changed, 2 not installed.
set -euo pipefail
unset PYTHONPATH PYTHONHOME

HERE=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
FOLDER=$(mktemp -d)
trap 'rm -rf "$FOLDER"' EXIT

install() {  # install NAME==VERSION ...: into the environment that `measure` uses
    "${PYTHON:-python3}" -m venv "$FOLDER/venv" && "$FOLDER/venv/bin/python" -m pip install --quiet "$@" || {
        echo "NOT INSTALLED: $*"
        exit 2
    }
}

measure() {  # runs the Python program on standard input in the temporary folder
    cat > "$FOLDER/program.py"
    (cd "$FOLDER" && PYTHONDONTWRITEBYTECODE=1 PYTHONPATH=$HERE "$FOLDER/venv/bin/python" program.py)
}
