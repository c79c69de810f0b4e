#include "config/config_table.h"

#include "config/config.h"

#define AT(member) offsetof(config, member), false, false
#define AT_OR_ZERO(member) offsetof(config, member), false, true
#define RELOADS(member) offsetof(config, member), true, false

const config_row config_table[] = {
    {"listen", CONFIG_TEXT, "", 0, 0, "",
     "Where to serve: unix:/path or HOST:PORT. Empty: hexad.sock in $RUNTIME_DIRECTORY (of systemd), else in"
     " state_dir. On a Unix socket callers are the users whose processes connect. A TCP port needs tokens, see"
     " token_file and tcp_without_tokens; it is not encrypted. Port 0 takes a free one, see port_file.",
     AT(listen)},
    {"unix_users", CONFIG_LIST, "", 0, 0, "",
     "Users, by name or number, who may read, submit and cancel on the Unix socket; separated by colons or commas."
     " The user that runs hexad and root may everything. A socket for others belongs where they can reach it.",
     AT(unix_users)},
    {"unix_groups", CONFIG_LIST, "", 0, 0, "", "Groups whose members may what unix_users may.",
     AT(unix_groups)},
    {"unix_admins", CONFIG_LIST, "", 0, 0, "", "Users who may everything on the Unix socket.",
     AT(unix_admins)},
    {"token_file", CONFIG_TEXT, "", 0, 0, "",
     "The bearer tokens, by their hashes, as hexadctl token makes it; of mode 0600, or 0640 if it belongs to root and"
     " to the group of the service. It is looked at for every use, so that a change holds at once. Empty: the file"
     " tokens in $CONFIGURATION_DIRECTORY (of the unit: /etc/hexad), else in state_dir, if it is there.",
     AT(token_file)},
    {"tcp_without_tokens", CONFIG_TEXT, "", 0, 0, "",
     "Whether a loopback port is served when there are no tokens: only with the words"
     " anyone-on-this-machine-may-submit-and-cancel, which is what it means. A port that other machines reach never"
     " is.",
     AT(tcp_without_tokens)},
    {"page_origins", CONFIG_WORDS, "", 0, 0, "",
     "Origins of web pages (https://gui.example, http://localhost:3000) that may send requests from a browser and read"
     " the answers; separated by commas, and the key may be repeated. A port that is served without tokens refuses"
     " requests for other hosts than its own and theirs (421), and those of pages of other origins (403).",
     AT(page_origins)},
    {"trusted_proxies", CONFIG_WORDS, "", 0, 0, "",
     "Addresses, or ranges (10.0.0.0/8), of proxies in front of a TCP port whose header Forwarded (RFC 7239) tells the"
     " client's address, for limits of connections and the log only; separated by commas, and the key may be repeated."
     " From others the header is ignored, and X-Forwarded-For always is.",
     AT(trusted_proxies)},
    {"port_file", CONFIG_TEXT, "", 0, 0, "",
     "A file that is given the address actually served, in one line, once it is. Empty: none.",
     AT(port_file)},
    {"state_dir", CONFIG_TEXT, "", 0, 0, "",
     "Directory of the queue, the attempts and the results; made when missing. On a local file"
     " system, and of one daemon only. Empty: $STATE_DIRECTORY (of systemd), else lib/hexad"
     " below the localstatedir of the build.",
     AT(state_dir)},
    {"input_roots", CONFIG_LIST, "", 0, 0, "",
     "Directories below which a job may name input files, or single files, separated by colons or commas; the key"
     " may be repeated. Empty: no job may read a file.",
     AT(input_roots)},
    {"output_roots", CONFIG_LIST, "", 0, 0, "",
     "Directories below which a job may have its results copied (output.directory), as input_roots. Empty: no job"
     " may.",
     AT(output_roots)},
    {"path_mappings", CONFIG_WORDS, "", 0, 0, "",
     "What directories of other machines are called here: from=to, separated by commas; the key may be repeated."
     " Z:/show=/mnt/show has a job that asks for Z:\\show\\a.vdb read /mnt/show/a.vdb. Input paths and output.directory"
     " are mapped when a job is submitted, by the longest from whose directories they begin with; in those that begin"
     " with a drive or \\\\ upper and lower case are one, and \\ is /. input_roots and output_roots hold for what comes"
     " out.",
     AT(path_mappings)},
    {"output_mode", CONFIG_TEXT, "0644", 0, 0, "",
     "Mode of these copies, octal; directories that are made for them can be searched, too, by who may read.",
     AT(output_mode)},
    {"output_group", CONFIG_TEXT, "", 0, 0, "",
     "Group that these copies belong to. Empty: that of the service.", AT(output_group)},
    {"workers", CONFIG_INTEGER, "0", 0, 1024, "processes",
     "Most attempts at once. As many run as fit into threads and host_memory_mb. 0: one per thread.",
     AT(workers)},
    {"threads", CONFIG_INTEGER, "0", 0, 4096, "threads",
     "Of all attempts together. A job that does not say solver.threads gets this divided by workers. 0: the"
     " processors there are.",
     AT(threads)},
    {"host_memory_mb", CONFIG_INTEGER, "0", 0, 1 << 30, "MiB",
     "Memory of all attempts together; each takes its limit from it. 0: nine tenths of the machine's, or of what"
     " the control group of the service may have.",
     AT(host_memory_mb)},
    {"worker", CONFIG_TEXT, "", 0, 0, "",
     "The program that runs a job. Empty: hexad-worker beside hexad, else in the bindir of the "
     "build.",
     AT(worker)},
    {"memory_mb", CONFIG_INTEGER, "4096", 16, 1 << 24, "MiB", "Memory of a job that names no limit.",
     AT(memory_mb)},
    {"file_mb", CONFIG_INTEGER, "65536", 0, 1 << 24, "MiB",
     "The longest file that a worker may write; 100 million points take 10 GiB. 0: no limit.",
     RELOADS(file_mb)},
    {"sandbox", CONFIG_SANDBOX, "available", 0, 0, "",
     "How workers are isolated. required: no network, no new privileges, a filter of system calls, and"
     " Landlock: input_roots can be read, the attempt's own directory can be written, nothing else;"
     " hexad does not start where the kernel has no Landlock. available: the same, and without"
     " Landlock where there is none; the log says so. off: nothing of it.",
     AT(sandbox)},
    {"timeout_s", CONFIG_REAL, "0", 0, 1e7, "s",
     "Time that a job that names no limit may run, all attempts together. 0: none.", RELOADS(timeout_s)},
    {"stall_s", CONFIG_REAL, "0", 0, 1e7, "s",
     "How long a worker may report no progress, of a job that names no limit. 0: for ever.",
     RELOADS(stall_s)},
    {"estimates", CONFIG_INTEGER, "2", 0, 1024, "processes",
     "How many specs that are only to be checked are looked at by workers at once, besides the attempts, each with the"
     " memory and threads of its job; others go without an estimate. 0: all do, and no input is looked into.",
     AT(estimates)},
    {"estimate_timeout_s", CONFIG_REAL, "10", 0.01, 3600, "s", "How long such a worker may take.",
     AT(estimate_timeout_s)},
    {"max_attempts", CONFIG_INTEGER, "3", 1, 100, "attempts",
     "How often a job whose worker crashes is tried, of a job that names no number.", AT(max_attempts)},
    {"max_interruptions", CONFIG_INTEGER, "20", 0, 1000000, "attempts",
     "How often the end of hexad itself, or of its host, may end an attempt of a job, or of a frame, before the job"
     " fails (interrupted). Such attempts do not count against max_attempts. 0: any number of times.",
     AT(max_interruptions)},
    {"retry_s", CONFIG_REAL, "1", 0, 86400, "s",
     "How long a job whose worker crashed waits before it is tried again; doubled after each further crash.",
     AT(retry_s)},
    {"retry_most_s", CONFIG_REAL, "300", 0, 86400, "s", "The longest of these waits.", AT(retry_most_s)},
    {"free_space_mb", CONFIG_INTEGER, "256", 0, 1 << 30, "MiB",
     "With less free on the disks of state_dir no job is started, /readyz says storage_full, and jobs wait until there is"
     " more. It is best above what the jobs that run at once write. 0: jobs are started on a full disk, too.",
     AT(free_space_mb)},
    {"reserve_mb", CONFIG_INTEGER, "16", 0, 1 << 20, "MiB",
     "Set aside in state_dir for the queue, besides what its log usually takes (5 MiB), so that jobs can be cancelled,"
     " deleted and ended, and hexad started, on a full disk; jobs are accepted while as much is free besides. 16 MiB are"
     " enough for some 400 such changes, one by one, until the disk has room again. 0: none.",
     AT(reserve_mb)},
    {"storage_retries", CONFIG_INTEGER, "300", 0, 1000000, "attempts",
     "How often a job is tried again because a disk was full (storage_full) or failed (storage_failed), that of"
     " output.directory, too. These attempts do not count against max_attempts; they wait retry_s, twice that, and so on"
     " up to retry_most_s, with whose default 300 take a day.",
     AT(storage_retries)},
    {"cache", CONFIG_INTEGER, "1", 0, 1, "",
     "1: a job that asks for the same as one before is given its result, while that is kept and no input was"
     " changed. 0: every job is run.",
     AT(cache)},
    {"user_queued", CONFIG_INTEGER, "0", 0, 1 << 30, "jobs",
     "Jobs of one user that have not ended; another one is refused. 0: any number.", AT(user_queued)},
    {"user_running", CONFIG_INTEGER, "0", 0, 1 << 20, "attempts",
     "Attempts of one user at once; the user's other jobs wait. 0: any number.", AT(user_running)},
    {"check_interval_s", CONFIG_REAL, "86400", 1, 1e7, "s",
     "How often the whole database is checked for damage, by a copy of it, at a time when nothing is stored; beside the"
     " quick check after each start. 0: not again after that.",
     AT_OR_ZERO(check_interval_s)},
    {"retention_s", CONFIG_REAL, "0", 0, 1e10, "s",
     "How long a job and its results are kept after its end, of a job that names no time. 0: for ever.",
     AT(retention_s)},
    {"grace_s", CONFIG_REAL, "5", 0, 3600, "s", "Between asking a worker to end and killing it.",
     RELOADS(grace_s)},
    {"drain_s", CONFIG_REAL, "30", 0, 1e6, "s",
     "At SIGTERM: how long running jobs may go on before they are put back in the queue.", RELOADS(drain_s)},
    {"body_limit_bytes", CONFIG_INTEGER, "1048576", 1, 1 << 30, "bytes", "Longest request body.",
     AT(body_limit_bytes)},
    {"upload_limit_bytes", CONFIG_INTEGER, "17179869184", 0, 1e15, "bytes",
     "Longest file that a client may send for its jobs. 0: none but empty ones.", AT(upload_limit_bytes)},
    {"upload_total_bytes", CONFIG_INTEGER, "137438953472", 0, 1e15, "bytes",
     "What all files that clients have sent may take together, in the directory inputs of state_dir.",
     AT(upload_total_bytes)},
    {"inputs_keep_s", CONFIG_REAL, "604800", 60, 1e10, "s",
     "How long such a file is kept after it was last sent, named by a job that is submitted, or read by one that begins;"
     " while a job that has not ended reads it, it stays. 0: for ever.",
     AT_OR_ZERO(inputs_keep_s)},
    {"header_limit_bytes", CONFIG_INTEGER, "32768", 4096, 1 << 20, "bytes",
     "Request line and headers of a request, and the headers of its reply.", AT(header_limit_bytes)},
    {"connection_limit", CONFIG_INTEGER, "2048", 1, 100000, "connections",
     "Connections at once. For one more the one without a token that has been idle longest is ended.",
     AT(connection_limit)},
    {"client_connection_limit", CONFIG_INTEGER, "256", 1, 100000, "connections",
     "Connections at once of one address on TCP, of those that have not shown a token; and of a stranger on the Unix"
     " socket. For one more the one that has been idle longest is ended.",
     AT(client_connection_limit)},
    {"user_connection_limit", CONFIG_INTEGER, "512", 1, 100000, "connections",
     "Connections at once of one user, by token or on the Unix socket, from all addresses together.",
     AT(user_connection_limit)},
    {"admin_connections", CONFIG_INTEGER, "32", 0, 100000, "connections",
     "How many of connection_limit are kept for administrators; half of it at most.", AT(admin_connections)},
    {"connection_timeout_s", CONFIG_REAL, "30", 0.1, 86400, "s",
     "How long a connection may be idle, and how long a client may take to send a request.",
     AT(connection_timeout_s)},
    {"wait_limit_s", CONFIG_REAL, "60", 0, 3600, "s",
     "The longest that a client may have an answer wait for a change (Prefer: wait).", AT(wait_limit_s)},
    {"kept_documents", CONFIG_INTEGER, "4096", 0, 1 << 20, "documents",
     "Documents of jobs that are kept ready to be sent again, each until its job changes. One takes its length, mostly"
     " 1 to 2 KiB; none longer than 16 KiB is kept. 0: none.",
     AT(kept_documents)},
    {"webhook_hosts", CONFIG_WORDS, "", 0, 0, "",
     "Hosts that a job may have told of its end (queue.webhook): HOST, for its ports 80 and 443, or HOST:PORT; separated"
     " by commas, and the key may be repeated. Empty: webhooks are refused and none is called.",
     AT(webhook_hosts)},
    {"webhook_secret_file", CONFIG_TEXT, "", 0, 0, "",
     "What webhooks are signed with: a file of mode 0600 with one line of at least 16 characters. webhook_hosts needs"
     " it. Each call has the headers of standardwebhooks.com: webhook-id, one for each end of a job however often it is"
     " told; webhook-timestamp, the second of the try; and webhook-signature, v1, and the base64 of the HMAC-SHA256 of"
     " ID.TIMESTAMP.BODY. A receiver refuses other signatures, old timestamps and what it knows.",
     AT(webhook_secret_file)},
    {"webhook_calls", CONFIG_INTEGER, "8", 1, 256, "calls",
     "Calls of webhooks at a time, each to another host.", AT(webhook_calls)},
    {"webhook_tries", CONFIG_INTEGER, "12", 1, 1000, "tries",
     "How often a webhook is called until its answer is one of 2xx. Redirects are not followed.",
     AT(webhook_tries)},
    {"webhook_timeout_s", CONFIG_REAL, "10", 0.1, 3600, "s",
     "Of one such call; others to the same host wait for it.", AT(webhook_timeout_s)},
    {"webhook_retry_s", CONFIG_REAL, "5", 0.01, 86400, "s",
     "How long after a call that failed the next is made; doubled after each further one.",
     AT(webhook_retry_s)},
    {"webhook_retry_most_s", CONFIG_REAL, "3600", 0.01, 1e6, "s", "The longest of these waits.",
     AT(webhook_retry_most_s)},
    {"log_level", CONFIG_LEVEL, "info", 0, 0, "", "error, warning, info or debug.", RELOADS(log_level)},
};

const size_t config_table_size = sizeof config_table / sizeof *config_table;
