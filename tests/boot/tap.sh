# SPDX-License-Identifier: Apache-2.0
# For checks in a booted system: TAP on standard output, what else is said on standard error. To be sourced.
count=0
failed=0

# check NAME COMMAND...
check() {
    name=$1
    shift
    count=$((count + 1))
    echo "# $count: $name" >&2
    if "$@" >&2; then
        echo "ok $count - $name"
    else
        failed=1
        echo "not ok $count - $name"
    fi
}

skip() {
    count=$((count + 1))
    echo "ok $count - $1 # SKIP $2"
}

# Until the command holds; half a minute at most.
until_true() {
    for _ in $(seq 300); do
        ! "$@" >/dev/null 2>&1 || return 0
        sleep 0.1
    done
    echo "in vain: $*"
    return 1
}
