#include "config/config_table.h"

#include "config/config.h"

/* A setting is called as its member of config. */
#define SETTING(member) .key = #member, .offset = offsetof(config, member)

const config_row config_table[] = {
    {SETTING(listen), .type = CONFIG_TEXT,
     .help =
         "Where to serve: unix:/path or HOST:PORT. Empty: hexad.sock in $RUNTIME_DIRECTORY (of systemd), else in"
         " state_dir. On a Unix socket callers are the users whose processes connect. A TCP port needs tokens, see"
         " token_file and tcp_without_tokens; it is not encrypted. Port 0 takes a free one, see port_file."},
    {SETTING(unix_users), .type = CONFIG_LIST,
     .help =
         "Users, by name or number, who may read, submit and cancel on the Unix socket; separated by colons or commas."
         " The user that runs hexad and root may everything. A socket for others belongs where they can reach it."},
    {SETTING(unix_groups), .type = CONFIG_LIST, .help = "Groups whose members may what unix_users may."},
    {SETTING(unix_admins), .type = CONFIG_LIST, .help = "Users who may everything on the Unix socket."},
    {SETTING(token_file), .type = CONFIG_TEXT,
     .help =
         "The bearer tokens, by their hashes, as hexadctl token makes it; of mode 0600, or 0640 if it belongs to root and"
         " to the group of the service. It is looked at for every use, so that a change holds at once. Empty: the file"
         " tokens in $CONFIGURATION_DIRECTORY (of the unit: /etc/hexad), else in state_dir, if it is there."},
    {SETTING(tcp_without_tokens), .type = CONFIG_TEXT,
     .help =
         "Whether a loopback port is served when there are no tokens: only with the words"
         " anyone-on-this-machine-may-submit-and-cancel, which is what it means. A port that other machines reach never"
         " is."},
    {SETTING(page_origins), .type = CONFIG_WORDS,
     .help =
         "Origins of web pages (https://gui.example, http://localhost:3000) that may send requests from a browser and read"
         " the answers; separated by commas, and the key may be repeated. A port that is served without tokens refuses"
         " requests for other hosts than its own and theirs (421), and those of pages of other origins (403)."},
    {SETTING(trusted_proxies), .type = CONFIG_WORDS,
     .help =
         "Addresses, or ranges (10.0.0.0/8), of proxies in front of a TCP port whose header Forwarded (RFC 7239) tells the"
         " client's address, for limits of connections and the log only; separated by commas, and the key may be repeated."
         " From others the header is ignored, and X-Forwarded-For always is."},
    {SETTING(port_file), .type = CONFIG_TEXT,
     .help = "A file that is given the address actually served, in one line, once it is. Empty: none."},
    {SETTING(state_dir), .type = CONFIG_TEXT,
     .help = "Directory of the queue, the attempts and the results; made when missing. On a local file"
             " system, and of one daemon only. Empty: $STATE_DIRECTORY (of systemd), else lib/hexad"
             " below the localstatedir of the build."},
    {SETTING(input_roots), .type = CONFIG_LIST,
     .help =
         "Directories below which a job may name input files, or single files, separated by colons or commas; the key"
         " may be repeated. Empty: no job may read a file."},
    {SETTING(output_roots), .type = CONFIG_LIST,
     .help =
         "Directories below which a job may have its results copied (output.directory), as input_roots. Empty: no job"
         " may."},
    {SETTING(path_mappings), .type = CONFIG_WORDS,
     .help =
         "What directories of other machines are called here: from=to, separated by commas; the key may be repeated."
         " Z:/show=/mnt/show has a job that asks for Z:\\show\\a.vdb read /mnt/show/a.vdb. Input paths and output.directory"
         " are mapped when a job is submitted, by the longest from whose directories they begin with; in those that begin"
         " with a drive or \\\\ upper and lower case are one, and \\ is /. input_roots and output_roots hold for what comes"
         " out."},
    {SETTING(output_mode), .type = CONFIG_TEXT, .default_text = "0644",
     .help =
         "Mode of these copies, octal; directories that are made for them can be searched, too, by who may read."},
    {SETTING(output_group), .type = CONFIG_TEXT,
     .help = "Group that these copies belong to. Empty: that of the service."},
    {SETTING(workers), .type = CONFIG_INTEGER, .default_text = "0", .low = 0, .high = 1024,
     .unit = "processes",
     .help = "Most attempts at once. As many run as fit into threads and host_memory_mb. 0: one per thread."},
    {SETTING(threads), .type = CONFIG_INTEGER, .default_text = "0", .low = 0, .high = 4096, .unit = "threads",
     .help =
         "Of all attempts together. A job that does not say solver.threads gets this divided by workers. 0: the"
         " processors there are."},
    {SETTING(host_memory_mb), .type = CONFIG_INTEGER, .default_text = "0", .low = 0, .high = 1 << 30,
     .unit = "MiB",
     .help =
         "Memory of all attempts together; each takes its limit from it. 0: nine tenths of the machine's, or of what"
         " the control group of the service may have."},
    {SETTING(worker), .type = CONFIG_TEXT,
     .help = "The program that runs a job. Empty: hexad-worker beside hexad, else in the bindir of the "
             "build."},
    {SETTING(memory_mb), .type = CONFIG_INTEGER, .default_text = "4096", .low = 16, .high = 1 << 24,
     .unit = "MiB", .help = "Memory of a job that names no limit."},
    {SETTING(file_mb), .type = CONFIG_INTEGER, .default_text = "65536", .low = 0, .high = 1 << 24,
     .unit = "MiB", .reloads = true,
     .help = "The longest file that a worker may write; 100 million points take 10 GiB. 0: no limit."},
    {SETTING(sandbox), .type = CONFIG_SANDBOX, .default_text = "available",
     .help =
         "How workers are isolated. required: no network, no new privileges, a filter of system calls, and"
         " Landlock: input_roots can be read, the attempt's own directory can be written, nothing else;"
         " hexad does not start where the kernel has no Landlock. available: the same, and without"
         " Landlock where there is none; the log says so. off: nothing of it."},
    {SETTING(timeout_s), .type = CONFIG_REAL, .default_text = "0", .low = 0, .high = 1e7, .unit = "s",
     .reloads = true, .help = "Time that a job that names no limit may run, all attempts together. 0: none."},
    {SETTING(stall_s), .type = CONFIG_REAL, .default_text = "0", .low = 0, .high = 1e7, .unit = "s",
     .reloads = true,
     .help = "How long a worker may report no progress, of a job that names no limit. 0: for ever."},
    {SETTING(estimates), .type = CONFIG_INTEGER, .default_text = "2", .low = 0, .high = 1024,
     .unit = "processes",
     .help =
         "How many specs that are only to be checked are looked at by workers at once, besides the attempts, each with the"
         " memory and threads of its job; others go without an estimate. 0: all do, and no input is looked into."},
    {SETTING(estimate_timeout_s), .type = CONFIG_REAL, .default_text = "10", .low = 0.01, .high = 3600,
     .unit = "s", .help = "How long such a worker may take."},
    {SETTING(max_attempts), .type = CONFIG_INTEGER, .default_text = "3", .low = 1, .high = 100,
     .unit = "attempts",
     .help = "How often a job whose worker crashes is tried, of a job that names no number."},
    {SETTING(max_interruptions), .type = CONFIG_INTEGER, .default_text = "20", .low = 0, .high = 1000000,
     .unit = "attempts",
     .help =
         "How often the end of hexad itself, or of its host, may end an attempt of a job, or of a frame, before the job"
         " fails (interrupted). Such attempts do not count against max_attempts. 0: any number of times."},
    {SETTING(retry_s), .type = CONFIG_REAL, .default_text = "1", .low = 0, .high = 86400, .unit = "s",
     .help =
         "How long a job whose worker crashed waits before it is tried again; doubled after each further crash."},
    {SETTING(retry_most_s), .type = CONFIG_REAL, .default_text = "300", .low = 0, .high = 86400, .unit = "s",
     .help = "The longest of these waits."},
    {SETTING(free_space_mb), .type = CONFIG_INTEGER, .default_text = "256", .low = 0, .high = 1 << 30,
     .unit = "MiB",
     .help =
         "With less free on the disks of state_dir no job is started, /readyz says storage_full, and jobs wait until there is"
         " more. It is best above what the jobs that run at once write. 0: jobs are started on a full disk, too."},
    {SETTING(reserve_mb), .type = CONFIG_INTEGER, .default_text = "16", .low = 0, .high = 1 << 20,
     .unit = "MiB",
     .help =
         "Set aside in state_dir for the queue, besides what its log usually takes (5 MiB), so that jobs can be cancelled,"
         " deleted and ended, and hexad started, on a full disk; jobs are accepted while as much is free besides. 16 MiB are"
         " enough for some 400 such changes, one by one, until the disk has room again. 0: none."},
    {SETTING(storage_retries), .type = CONFIG_INTEGER, .default_text = "300", .low = 0, .high = 1000000,
     .unit = "attempts",
     .help =
         "How often a job is tried again because a disk was full (storage_full) or failed (storage_failed), that of"
         " output.directory, too. These attempts do not count against max_attempts; they wait retry_s, twice that, and so on"
         " up to retry_most_s, with whose default 300 take a day."},
    {SETTING(cache), .type = CONFIG_INTEGER, .default_text = "1", .low = 0, .high = 1,
     .help =
         "1: a job that asks for the same as one before is given its result, while that is kept and no input was"
         " changed. 0: every job is run."},
    {SETTING(user_queued), .type = CONFIG_INTEGER, .default_text = "0", .low = 0, .high = 1 << 30,
     .unit = "jobs", .help = "Jobs of one user that have not ended; another one is refused. 0: any number."},
    {SETTING(user_running), .type = CONFIG_INTEGER, .default_text = "0", .low = 0, .high = 1 << 20,
     .unit = "attempts", .help = "Attempts of one user at once; the user's other jobs wait. 0: any number."},
    {SETTING(check_interval_s), .type = CONFIG_REAL, .default_text = "86400", .low = 1, .high = 1e7,
     .or_zero = true, .unit = "s",
     .help =
         "How often the whole database is checked for damage, by a copy of it, at a time when nothing is stored; beside the"
         " quick check after each start. 0: not again after that."},
    {SETTING(retention_s), .type = CONFIG_REAL, .default_text = "0", .low = 0, .high = 1e10, .unit = "s",
     .help =
         "How long a job and its results are kept after its end, of a job that names no time. 0: for ever."},
    {SETTING(grace_s), .type = CONFIG_REAL, .default_text = "5", .low = 0, .high = 3600, .unit = "s",
     .reloads = true, .help = "Between asking a worker to end and killing it."},
    {SETTING(drain_s), .type = CONFIG_REAL, .default_text = "30", .low = 0, .high = 1e6, .unit = "s",
     .reloads = true,
     .help = "At SIGTERM: how long running jobs may go on before they are put back in the queue."},
    {SETTING(body_limit_bytes), .type = CONFIG_INTEGER, .default_text = "1048576", .low = 1, .high = 1 << 30,
     .unit = "bytes", .help = "Longest request body."},
    {SETTING(upload_limit_bytes), .type = CONFIG_INTEGER, .default_text = "17179869184", .low = 0,
     .high = 1e15, .unit = "bytes",
     .help = "Longest file that a client may send for its jobs. 0: none but empty ones."},
    {SETTING(upload_total_bytes), .type = CONFIG_INTEGER, .default_text = "137438953472", .low = 0,
     .high = 1e15, .unit = "bytes",
     .help =
         "What all files that clients have sent may take together, in the directory inputs of state_dir."},
    {SETTING(inputs_keep_s), .type = CONFIG_REAL, .default_text = "604800", .low = 60, .high = 1e10,
     .or_zero = true, .unit = "s",
     .help =
         "How long such a file is kept after it was last sent, named by a job that is submitted, or read by one that begins;"
         " while a job that has not ended reads it, it stays. 0: for ever."},
    {SETTING(header_limit_bytes), .type = CONFIG_INTEGER, .default_text = "32768", .low = 4096,
     .high = 1 << 20, .unit = "bytes",
     .help = "Request line and headers of a request, and the headers of its reply."},
    {SETTING(connection_limit), .type = CONFIG_INTEGER, .default_text = "2048", .low = 1, .high = 100000,
     .unit = "connections",
     .help =
         "Connections at once. For one more the one without a token that has been idle longest is ended."},
    {SETTING(client_connection_limit), .type = CONFIG_INTEGER, .default_text = "256", .low = 1,
     .high = 100000, .unit = "connections",
     .help =
         "Connections at once of one address on TCP, of those that have not shown a token; and of a stranger on the Unix"
         " socket. For one more the one that has been idle longest is ended."},
    {SETTING(user_connection_limit), .type = CONFIG_INTEGER, .default_text = "512", .low = 1, .high = 100000,
     .unit = "connections",
     .help = "Connections at once of one user, by token or on the Unix socket, from all addresses together."},
    {SETTING(admin_connections), .type = CONFIG_INTEGER, .default_text = "32", .low = 0, .high = 100000,
     .unit = "connections",
     .help = "How many of connection_limit are kept for administrators; half of it at most."},
    {SETTING(connection_timeout_s), .type = CONFIG_REAL, .default_text = "30", .low = 0.1, .high = 86400,
     .unit = "s",
     .help = "How long a connection may be idle, and how long a client may take to send a request."},
    {SETTING(wait_limit_s), .type = CONFIG_REAL, .default_text = "60", .low = 0, .high = 3600, .unit = "s",
     .help = "The longest that a client may have an answer wait for a change (Prefer: wait)."},
    {SETTING(kept_documents), .type = CONFIG_INTEGER, .default_text = "4096", .low = 0, .high = 1 << 20,
     .unit = "documents",
     .help =
         "Documents of jobs that are kept ready to be sent again, each until its job changes. One takes its length, mostly"
         " 1 to 2 KiB; none longer than 16 KiB is kept. 0: none."},
    {SETTING(webhook_hosts), .type = CONFIG_WORDS,
     .help =
         "Hosts that a job may have told of its end (queue.webhook): HOST, for its ports 80 and 443, or HOST:PORT; separated"
         " by commas, and the key may be repeated. Empty: webhooks are refused and none is called."},
    {SETTING(webhook_secret_file), .type = CONFIG_TEXT,
     .help =
         "What webhooks are signed with: a file of mode 0600 with one line of at least 16 characters. webhook_hosts needs"
         " it. Each call has the headers of standardwebhooks.com: webhook-id, one for each end of a job however often it is"
         " told; webhook-timestamp, the second of the try; and webhook-signature, v1, and the base64 of the HMAC-SHA256 of"
         " ID.TIMESTAMP.BODY. A receiver refuses other signatures, old timestamps and what it knows."},
    {SETTING(webhook_calls), .type = CONFIG_INTEGER, .default_text = "8", .low = 1, .high = 256,
     .unit = "calls", .help = "Calls of webhooks at a time, each to another host."},
    {SETTING(webhook_tries), .type = CONFIG_INTEGER, .default_text = "12", .low = 1, .high = 1000,
     .unit = "tries",
     .help = "How often a webhook is called until its answer is one of 2xx. Redirects are not followed."},
    {SETTING(webhook_timeout_s), .type = CONFIG_REAL, .default_text = "10", .low = 0.1, .high = 3600,
     .unit = "s", .help = "Of one such call; others to the same host wait for it."},
    {SETTING(webhook_retry_s), .type = CONFIG_REAL, .default_text = "5", .low = 0.01, .high = 86400,
     .unit = "s",
     .help = "How long after a call that failed the next is made; doubled after each further one."},
    {SETTING(webhook_retry_most_s), .type = CONFIG_REAL, .default_text = "3600", .low = 0.01, .high = 1e6,
     .unit = "s", .help = "The longest of these waits."},
    {SETTING(log_level), .type = CONFIG_LEVEL, .default_text = "info", .reloads = true,
     .help = "error, warning, info or debug."},
};

const size_t config_table_size = sizeof config_table / sizeof *config_table;
