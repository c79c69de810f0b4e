# What bootcheck runs in the container, as root, with the path of hexad.conf. TAP on standard output.
set -u
settings=$1
HEXAD_SERVER=unix:/run/hexad/hexad.sock
export HEXAD_SERVER
count=0

# check NAME COMMAND...
check() {
    name=$1
    shift
    count=$((count + 1))
    echo "# $count: $name" >&2
    if "$@" >&2; then echo "ok $count - $name"; else echo "not ok $count - $name"; fi
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

main_pid() { systemctl show -P MainPID hexad.service; }
status_of() { sed -n "s/^$1:[[:space:]]*//p" "/proc/$(main_pid)/status"; }
says() { [ "$(systemctl show -P "$1" hexad.service)" = "$2" ]; }
status_says() { systemctl show -P StatusText hexad.service | grep -q "$1"; }
logged() { journalctl -u hexad.service -o cat | grep -q "$@"; }
state_is() { hexadctl show "$1" | grep -q " $2"; }

spec() { echo "{\"version\": 1, \"surface\": $1, \"sampling\": {\"count\": 300}}"; }
sphere='{"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}}'
succeeds() { spec "$1" | hexadctl submit - --wait; }
submit_long() {
    echo "{\"version\": 1, \"surface\": $sphere, \"sampling\": {\"count\": 20000}, \"solver\": {\"max_sweeps\": 1000000,
        \"step_tolerance\": 1e-12, \"energy_tolerance\": 1e-12}}" | hexadctl submit -
}

is_started_by_a_connection() {
    says ActiveState inactive && systemctl is-active hexad.socket && hexadctl list && says ActiveState active
}

is_confined() {
    [ "$(status_of NoNewPrivs)" = 1 ] && [ "$(status_of Seccomp)" = 2 ] &&
        [ "$(status_of CapEff)" = 0000000000000000 ] && [ "$(ps_user)" = hexad ] &&
        [ "$(readlink "/proc/$(main_pid)/ns/net")" != "$(readlink /proc/self/ns/net)" ]
}
ps_user() { stat -c %U "/proc/$(main_pid)"; }

# Of a job that a worker runs: a repeat would be given the result of the one before.
journal_has_fields() {
    job=$(spec "$(echo "$sphere" | sed 's/1}}$/2}}/')" | hexadctl submit -)
    hexadctl wait "$job" && journalctl -o export "HEXAD_JOB=$job" >/tmp/entries &&
        grep -q '^HEXAD_ATTEMPT=1$' /tmp/entries && grep -q '^HEXAD_WORKER=[0-9]*$' /tmp/entries &&
        grep -q '^PRIORITY=6$' /tmp/entries
}

strangers_are_kept_out() {
    setpriv --reuid=nobody --regid=nogroup --clear-groups hexadctl list
    [ $? -eq 3 ] # no server, as far as they can tell
}

# The token may read and no more, although root brings it.
tokens_are_credentials() {
    token=$(hexadctl token add reader --scopes read --file "${settings%/*}/hexad.tokens") &&
        systemctl restart hexad.service && HEXAD_TOKEN=$token hexadctl list &&
        ! spec "$sphere" | HEXAD_TOKEN=$token hexadctl submit - && ! HEXAD_TOKEN=none hexadctl list && hexadctl list
}

reloads() {
    echo "log_level = debug" >>"$settings"
    systemctl reload hexad.service && until_true logged "setting log_level has changed"
}

# A drain of a second: what still runs is put back, and runs again after the start.
is_drained() {
    echo "drain_s = 1" >>"$settings"
    systemctl reload hexad.service && until_true logged "setting drain_s has changed" &&
        job=$(submit_long) && until_true state_is "$job" running &&
        systemctl stop hexad.service && says Result success && says ExecMainStatus 0 &&
        hexadctl list && until_true state_is "$job" running && hexadctl cancel "$job" &&
        until_true state_is "$job" cancelled
}

is_killed() {
    job=$(submit_long)
    until_true state_is "$job" running && systemctl kill --kill-who=main -s KILL hexad.service &&
        until_true says NRestarts 1 && until_true state_is "$job" running && hexadctl cancel "$job"
}

# The whole process stands still, which no timer inside of it would notice.
is_watched() {
    mkdir -p /run/systemd/system/hexad.service.d
    printf '[Service]\nWatchdogSec=2\nTimeoutAbortSec=1\n' >/run/systemd/system/hexad.service.d/hurry.conf
    systemctl daemon-reload && systemctl restart hexad.service && systemctl reset-failed hexad.service
    kill -STOP "$(main_pid)"
    until_true says NRestarts 1 && until_true says ActiveState active && hexadctl list
}

is_not_started_again_with_bad_settings() {
    cp "$settings" /tmp/settings && echo "workers = many" >>"$settings"
    ! systemctl restart hexad.service && says ExecMainStatus 2 && says NRestarts 0 && says ActiveState failed
    done=$?
    cp /tmp/settings "$settings"
    return $done
}

echo "input_roots = /srv/input" >>"$settings"
printf 'OFF\n4 4 0\n1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n' >/srv/input/mesh.off
check "the system is up, nothing has failed" test -z "$(systemctl --failed -q --plain)"
check "a connection starts the service" is_started_by_a_connection
check "it has no privileges and no network" is_confined
check "workers are isolated by Landlock" logged "workers have .* Landlock version"
check "a job of a formula" succeeds "$sphere"
check "a job of a volume" succeeds '{"vdb": {"path": "/srv/input/example.vdb"}}'
check "a job of a mesh" succeeds '{"mesh": {"path": "/srv/input/mesh.off", "resolution": 32}}'
check "the journal knows job, attempt and worker" journal_has_fields
check "the status counts jobs" until_true status_says "[0-9] queued, [0-9]* running"
check "strangers do not reach the socket" strangers_are_kept_out
check "tokens are credentials" tokens_are_credentials
check "the exposure is 1.5 at most" systemd-analyze security --no-pager --threshold=15 hexad.service
check "settings are reloaded" reloads
check "a stop drains, and loses nothing" is_drained
check "a daemon that was killed comes back" is_killed
check "a daemon that stands still is ended and comes back" is_watched
check "bad settings are not tried again" is_not_started_again_with_bad_settings
echo "1..$count"
journalctl -u hexad.service --no-pager >&2
