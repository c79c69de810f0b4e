#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# one_make.sh: lets one make at a time work in the current directory, since two would write the same libraries.
#
# The Makefile runs it when make reads it. Prints nothing if its parent, a make, may go on: the directory is then held
# for as long as that process lives. Otherwise prints which process holds the directory. A make that was started,
# directly or not, by the one that holds the directory may go on.
lock=.make.lock

# stat_of PID FIELD: a field of /proc/PID/stat, counted from the one after the name: 2 is the parent, 20 the start time
stat_of() {
    sed 's/.*) //' "/proc/$1/stat" 2>/dev/null | cut -d ' ' -f "$2"
}

command -v flock >/dev/null && [ -r /proc/self/stat ] || exit 0
exec 9>>"$lock" || exit 0
flock 9
read -r holder started <"$lock" || :
if [ -n "$holder" ] && [ "$(stat_of "$holder" 20)" = "$started" ]; then
    process=$PPID
    while [ "${process:-0}" -gt 1 ]; do
        [ "$process" -ne "$holder" ] || exit 0
        process=$(stat_of "$process" 2)
    done
    echo "another make (process $holder) works in $PWD: wait for its end, or use a build directory of its own"
    exit 0
fi
echo "$PPID $(stat_of "$PPID" 20)" >"$lock"
