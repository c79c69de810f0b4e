# SPDX-License-Identifier: Apache-2.0
# What bootcheck runs in the booted system, as root, with the path of hexad.conf and the directory of the examples. TAP
# on standard output.
set -u
settings=$1
examples=$2
HEXAD_SERVER=unix:/run/hexad/hexad.sock
export HEXAD_SERVER
. /root/tap.sh

main_pid() { systemctl show -P MainPID hexad.service; }
status_of() { sed -n "s/^$1:[[:space:]]*//p" "/proc/$(main_pid)/status"; }
says() { [ "$(systemctl show -P "$1" hexad.service)" = "$2" ]; }
status_says() { systemctl show -P StatusText hexad.service | grep -q "$1"; }
logged() { journalctl -u hexad.service -o cat | grep -q "$@"; }
restarts_reach() { [ "$(systemctl show -P NRestarts hexad.service)" -ge "$1" ]; }
seconds() { cut -d. -f1 /proc/uptime; }

# drop_in UNIT NAME <TEXT; gone again by remove_drop_ins
drop_in() {
    mkdir -p "/run/systemd/system/$1.d"
    cat >"/run/systemd/system/$1.d/$2.conf" && systemctl daemon-reload
}
remove_drop_ins() {
    rm -rf /run/systemd/system/hexad.service.d /run/systemd/system/hexad.socket.d
    systemctl daemon-reload
}

# with_settings COMMAND...: the command may change hexad.conf and the units; afterwards all is as it was.
with_settings() {
    cp "$settings" /tmp/settings
    "$@"
    result=$?
    cp /tmp/settings "$settings"
    remove_drop_ins
    systemctl stop hexad.service hexad.socket
    systemctl reset-failed
    systemctl start hexad.socket
    return $result
}
state_is() { hexadctl show "$1" | grep -q " $2"; }

spec() { echo "{\"version\": 1, \"surface\": $1, \"sampling\": {\"count\": 300}}"; }
sphere='{"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": 1}}'
# Whatever the outcome: so few points do not resolve every surface.
succeeds() {
    spec "$1" | hexadctl submit - --wait
    case $? in 0 | 10 | 11) ;; *) return 1 ;; esac
}
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
tokens_hold_at_once() {
    before=$(main_pid)
    token=$(umask 077 && hexadctl token add reader --scopes read) && HEXAD_TOKEN=$token hexadctl list &&
        ! spec "$sphere" | HEXAD_TOKEN=$token hexadctl submit - && ! HEXAD_TOKEN=none hexadctl list &&
        hexadctl token revoke "$(hexadctl token list | awk '$2 == "reader" { print $1 }')" &&
        ! HEXAD_TOKEN=$token hexadctl list && hexadctl list && [ "$(main_pid)" = "$before" ]
}

# Of root, and seen by the service as read-only, whatever the file's mode says.
tokens_are_of_root() {
    [ "$(stat -c %U:%G:%a /etc/hexad/tokens)" = root:hexad:640 ] && [ "$(stat -c %U:%a /etc/hexad)" = root:755 ] &&
        ! setpriv --reuid=hexad --regid=hexad --clear-groups sh -c ': >>/etc/hexad/tokens' &&
        ! setpriv --reuid=hexad --regid=hexad --clear-groups sh -c ': >/etc/hexad/other' &&
        ! setpriv --reuid=nobody --regid=nogroup --clear-groups cat /etc/hexad/tokens
}

as_nobody() {
    setpriv --reuid=nobody --regid=nogroup --clear-groups "$@"
}

# The mode of the socket changes at once; the setting takes effect when the service has read it.
lets_a_user_in_and_out() {
    ! as_nobody hexadctl list && hexad --allow nobody && until_true as_nobody hexadctl list &&
        hexad --deny nobody && ! as_nobody hexadctl list
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

# The serving thread alone stands still, and the supervisor advances.
notices_a_stuck_serving_thread() {
    printf '[Service]\nWatchdogSec=2\nTimeoutAbortSec=1\n' | drop_in hexad.service hurry
    systemctl restart hexad.service && systemctl reset-failed hexad.service
    thread=$(grep -lx serving /proc/"$(main_pid)"/task/*/comm | sed 's,.*/task/,,; s,/comm,,')
    # PTRACE_SEIZE, then PTRACE_INTERRUPT (x86-64); then takes the stop and the end (__WALL), without which the process stays
    perl -e 'for $request (0x4206, 0x4207) { syscall(101, $request, $ARGV[0] + 0, 0, 0) == 0 or die $! }
        1 until waitpid($ARGV[0], 0x40000000) < 0' "$thread" &
    tracer=$!
    until_true logged "the serving thread has not advanced for" && until_true restarts_reach 1 &&
        until_true says ActiveState active && hexadctl list
    noticed=$?
    kill "$tracer" 2>/dev/null
    return $noticed
}

is_not_started_again_with_bad_settings() {
    echo "workers = many" >>"$settings"
    ! systemctl restart hexad.service && says ExecMainStatus 2 && says NRestarts 0 && says ActiveState failed
}

# A connection that waits starts the service as soon as it has failed. That ends, and the client is told. The limit's
# interval is for a machine on which a start takes seconds (test_units looks at the unit's own).
gives_up_on_bad_settings() {
    printf '[Unit]\nStartLimitIntervalSec=600\n' | drop_in hexad.service interval
    echo "workers = many" >>"$settings"
    systemctl stop hexad.service
    until_true socket_has_given_up && says ExecMainStatus 2 && ! hexadctl list 2>/tmp/given_up
    cat /tmp/given_up && grep -q 'systemctl reset-failed hexad.service hexad.socket' /tmp/given_up
}
socket_has_given_up() {
    ! hexadctl list && systemctl is-failed hexad.socket
}

# The root comes late; it may be looked for at the pace of RestartSec=5 only, and without end.
waits_for_a_late_root() {
    echo "input_roots = /srv/late" >>"$settings"
    systemctl stop hexad.service && systemctl reset-failed hexad.service
    begin=$(seconds)
    systemctl start --no-block hexad.service
    until_true restarts_reach 3 && took=$(($(seconds) - begin)) || return 1
    echo "three restarts took $took s"
    [ "$took" -ge 14 ] && logged "cannot open the input root /srv/late" && mkdir /srv/late &&
        mount -t tmpfs -o mode=755 late /srv/late && cp /srv/input/mesh.off /srv/late &&
        until_true says ActiveState active &&
        succeeds '{"mesh": {"path": "/srv/late/mesh.off", "resolution": 24}}'
}

group_of_service() { echo "/sys/fs/cgroup$(systemctl show -P ControlGroup hexad.service)"; }

# A worker that needs more than the service may have. The kernel ends it, and only it; by default systemd would see that
# and stop the service, with a drain.
outlives_a_worker_out_of_memory() {
    printf '[Service]\nMemoryMax=300M\nMemorySwapMax=0\n' | drop_in hexad.service memory
    printf 'host_memory_mb = 40000\nworkers = 2\nthreads = 2\n' >>"$settings"
    systemctl restart hexad.service && systemctl reset-failed hexad.service
    daemon=$(main_pid)
    calm=$(submit_long) && until_true state_is "$calm" running &&
        hungry=$(echo "{\"version\": 1, \"surface\": $sphere, \"sampling\": {\"count\": 30000000},
            \"limits\": {\"memory_mb\": 16000, \"max_attempts\": 1}}" | hexadctl submit -) &&
        until_true state_is "$hungry" failed && hexadctl show "$hungry" &&
        grep -q '^oom_kill [1-9]' "$(group_of_service)/memory.events" &&
        until_true logged "killed by the OOM killer" && says ActiveState active && [ "$(main_pid)" = "$daemon" ] &&
        says NRestarts 0 && succeeds "$(echo "$sphere" | sed 's/1}}$/3}}/')" && state_is "$calm" running &&
        hexadctl cancel "$calm" && until_true state_is "$calm" cancelled
}

# A worker that takes 300 MB for a job of the name hungry, whatever its limit is, and is hexad-worker for others.
make_hungry_worker() {
    cat >/srv/worker <<'HUNGRY'
#!/bin/sh
spec=$(cat)
case $spec in *hungry*) exec perl -e '$all = "x" x 300_000_000; sleep 600' ;; esac
echo "$spec" | hexad-worker "$@"
HUNGRY
    chmod 755 /srv/worker
}

# The group of an attempt bounds it. It is not tried again, and others go on, also after a death of the daemon. No other
# job has 301 points, whose result it would be given.
keeps_limits_of_memory() {
    make_hungry_worker
    drop_in hexad.service memory <"$examples/memory.conf"
    printf 'worker = /srv/worker\nworkers = 2\nthreads = 2\nmemory_mb = 512\n' >>"$settings"
    systemctl restart hexad.service && systemctl reset-failed hexad.service
    daemon=$(main_pid)
    logged "memory limits: enforced by the kernel" &&
        systemd-analyze security --no-pager --threshold=8 hexad.service >/tmp/exposure && tail -n 1 /tmp/exposure &&
        calm=$(submit_long) && until_true state_is "$calm" running &&
        hungry=$(echo "{\"version\": 1, \"name\": \"hungry\", \"surface\": $sphere, \"sampling\": {\"count\": 301},
            \"limits\": {\"memory_mb\": 64, \"max_attempts\": 3}}" | hexadctl submit -) &&
        until_true state_is "$hungry" failed && hexadctl --json show "$hungry" | tee /tmp/hungry &&
        grep -q '"code": *"limit_memory"' /tmp/hungry && grep -q '"reason": *"out of memory: signal 9"' /tmp/hungry &&
        grep -q '"memory_limit_bytes": *67108864' /tmp/hungry && grep -q '"attempt": *1,' /tmp/hungry &&
        peak=$(sed -n 's/.*"peak_memory_bytes": *\([0-9]*\).*/\1/p' /tmp/hungry) &&
        [ "$peak" -le 67108864 ] && [ "$peak" -gt 60000000 ] &&
        says ActiveState active && [ "$(main_pid)" = "$daemon" ] && says NRestarts 0 &&
        succeeds "$(echo "$sphere" | sed 's/1}}$/4}}/')" && state_is "$calm" running &&
        [ "$(find "$(group_of_service)" -name 'attempt.*' | wc -l)" -eq 1 ] &&
        systemctl kill --kill-who=main -s KILL hexad.service && until_true says NRestarts 1 &&
        until_true state_is "$calm" running && hexadctl cancel "$calm" && until_true state_is "$calm" cancelled
}

# By the example, and with no network for the service all the same.
serves_tcp() {
    token=$(hexadctl token add remote) && drop_in hexad.socket tcp <"$examples/tcp.conf" &&
        systemctl stop hexad.service hexad.socket && systemctl start hexad.socket &&
        HEXAD_SERVER=http://127.0.0.1:8642 HEXAD_TOKEN=$token timeout 60 hexadctl list &&
        ! HEXAD_SERVER=http://127.0.0.1:8642 timeout 60 hexadctl list && is_confined
}

# The service runs without waiting for a client, and a repeated command changes nothing.
opens_a_port() {
    systemctl stop hexad.service hexad.socket
    hexad --open-port nobody >/tmp/opened && cat /tmp/opened && says ActiveState active && daemon=$(main_pid) &&
        HEXAD_SERVER=http://127.0.0.1:8642 HEXAD_TOKEN=$(head -n 1 /tmp/opened) timeout 60 hexadctl list &&
        hexad --open-port nobody >/tmp/again && cat /tmp/again && grep -q 'nobody has 1 token already' /tmp/again &&
        grep -q 'open http://127.0.0.1:8642/' /tmp/again && [ "$(main_pid)" = "$daemon" ]
    opened=$?
    rm -r /etc/systemd/system/hexad.socket.d
    return $opened
}

# Takes one call on 127.0.0.1:9999 into /tmp/call.
receive_a_call() {
    perl -MIO::Socket::INET -e '
        $listener = IO::Socket::INET->new(Listen => 5, LocalAddr => "127.0.0.1:9999", ReuseAddr => 1) or die $!;
        $caller = $listener->accept or die $!;
        while (<$caller>) { $head .= $_; $length = $1 if /^content-length: (\d+)/i; last if /^\r?\n$/ }
        read $caller, $body, $length;
        print $caller "HTTP/1.1 204 No Content\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
        close $caller;
        print $head, $body, "\n"' >/tmp/call
}

calls_webhooks() {
    mkdir -p /etc/hexad && (umask 077 && echo "correct horse battery staple" >/etc/hexad/webhook-secret) &&
        chgrp hexad /etc/hexad/webhook-secret && chmod 640 /etc/hexad/webhook-secret || return 1
    printf 'webhook_hosts = 127.0.0.1:9999\nwebhook_secret_file = /etc/hexad/webhook-secret\n' >>"$settings"
    drop_in hexad.service webhooks <"$examples/webhooks.conf" && systemctl restart hexad.service || return 1
    receive_a_call &
    receiver=$!
    job=$(echo "{\"version\": 1, \"surface\": $sphere, \"sampling\": {\"count\": 300},
        \"queue\": {\"webhook\": \"http://127.0.0.1:9999/done\"}}" | hexadctl submit -) && hexadctl wait "$job" &&
        until_true grep -q "$job" /tmp/call && grep -qi '^webhook-signature: v1,' /tmp/call &&
        until_true logged "webhook delivered job=$job"
    called=$?
    kill "$receiver" 2>/dev/null
    systemd-analyze security --no-pager hexad.service | tail -n 1
    return $called
}

# As doc/farm.md says, word by word. Slurm resolves no name, not even localhost, before a machine has a second address.
runs_on_slurm() {
    perl -e '$to = pack("a16 S n N x8", "lo:1", 2, 0, 0x0a000001); socket(S, 2, 2, 0) && ioctl(S, 0x8916, $to) or die' || return 1
    { sed -n '/^   ClusterName/,/^   PartitionName/s/^   //p' /root/farm.md | sed '/^NodeName/d'
      echo "$(slurmd -C | head -n 1) NodeAddr=127.0.0.1 State=UNKNOWN"; } >/etc/slurm/slurm.conf
    systemctl restart munge slurmctld slurmd && until_true sh -c 'sinfo -h -o %T | grep -qx idle' || return 1
    install -d -o hexad -g hexad -m 700 /srv/hexad
    sed -n '/^   engine = slurm/,/^   ```/s/^   \([a-z]\)/\1/p' /root/farm.md >>"$settings"
    drop_in hexad.service slurm <"$examples/slurm.conf" && systemctl restart hexad.service || return 1
    succeeds "$sphere" && squeue -h --states=all -o "%j %T %u" | grep '^hexad-.* COMPLETED hexad$'
}

echo "input_roots = /srv/input" >>"$settings"
printf 'OFF\n4 4 0\n1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n' >/srv/input/mesh.off
check "the system is up, nothing has failed" test -z "$(systemctl --failed -q --plain)"
check "a connection starts the service" is_started_by_a_connection
check "it has no privileges and no network" is_confined
check "workers are isolated by Landlock" logged "worker sandbox: .*(Landlock version"
check "a job of a formula" succeeds "$sphere"
check "a job of a volume" succeeds '{"vdb": {"path": "/srv/input/example.vdb"}}'
check "a job of a mesh" succeeds '{"mesh": {"path": "/srv/input/mesh.off", "resolution": 32}}'
check "the journal knows job, attempt and worker" journal_has_fields
check "the status counts jobs" until_true status_says "[0-9] queued, [0-9]* running"
check "strangers do not reach the socket" strangers_are_kept_out
check "tokens hold at once, and are worth nothing at once when revoked" tokens_hold_at_once
check "tokens belong to root" tokens_are_of_root
check "the exposure is 0.6 at most" systemd-analyze security --no-pager --threshold=6 hexad.service
check "root lets a user in, and out again" lets_a_user_in_and_out
check "settings are reloaded" reloads
check "a stop drains, and loses nothing" is_drained
check "a daemon that was killed comes back" is_killed
check "a daemon that stands still is ended and comes back" is_watched
remove_drop_ins
check "a daemon whose serving thread stands still is ended and comes back" with_settings notices_a_stuck_serving_thread
check "bad settings are not tried again" with_settings is_not_started_again_with_bad_settings
check "bad settings are not tried for ever for a client that waits" with_settings gives_up_on_bad_settings
check "an input root that comes late is waited for" with_settings waits_for_a_late_root
if grep -qw memory /sys/fs/cgroup/cgroup.controllers 2>/dev/null; then
    check "a worker out of memory dies alone" with_settings outlives_a_worker_out_of_memory
    check "the example memory.conf keeps limits of memory" with_settings keeps_limits_of_memory
else
    for name in "a worker out of memory dies alone" "the example memory.conf keeps limits of memory"; do
        skip "$name" "this container has no memory controller (see bootcheck, KERNEL)"
    done
fi
check "the example tcp.conf serves a port" with_settings serves_tcp
check "hexad --open-port opens a port and starts the service" with_settings opens_a_port
check "the example webhooks.conf lets webhooks be called" with_settings calls_webhooks
if command -v slurmd >/dev/null; then
    check "the example slurm.conf lets attempts run in Slurm" with_settings runs_on_slurm
else
    skip "the example slurm.conf lets attempts run in Slurm" "the base system is older than this check: remove it"
fi
check "a connection starts the service after all that" hexadctl list
echo "1..$count"
journalctl -u hexad.service --no-pager >&2
