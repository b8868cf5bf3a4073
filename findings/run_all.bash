#!/usr/bin/env bash
# Runs every finding of this folder and prints a line for each; fails if one changed or could not be installed.
cd "$(dirname "$0")" || exit 1
log=$(mktemp)
trap 'rm -f "$log"' EXIT
failed=0
for script in *.sh; do
    bash "$script" > "$log" 2>&1
    case $? in
        0) state="as found" ;;
        1) state="CHANGED" ;;
        2) state="NOT INSTALLED" ;;
        *) state="FAILED" ;;
    esac
    printf '%-14s %s\n' "$state" "${script%.sh}"
    if [ "$state" != "as found" ]; then
        failed=$((failed + 1))
        sed 's/^/    /' "$log"
    fi
done
[ "$failed" = 0 ] || { echo "$failed finding(s) no longer as described"; exit 1; }
