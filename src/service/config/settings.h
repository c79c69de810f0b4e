// SPDX-License-Identifier: Apache-2.0
/* settings: all settings of the daemon.
 *
 * SETTING(KEY, TYPE, RANK, ...) is one setting: config.h makes a member of it, config_table.c a row of the
 * table, whose remaining members follow (config_table.h). Both define SETTING before they include this file.
 * The first sentence of a help text is the short help.
 */
SETTING(
    listen, WORDS, BASIC,
    .help =
        "The addresses to serve, separated by commas: unix:/path, HOST:PORT or unix:. The last is the "
        "socket hexad.sock in $RUNTIME_DIRECTORY, which systemd sets, otherwise in state_dir. Empty: unix:. Example: "
        "unix:, 127.0.0.1:8642 serves the Unix socket, which hexadctl and hexad --allow use, and a port. "
        "Under systemd, hexad.socket determines the addresses instead. On a Unix socket the caller is the "
        "user whose process connects. A TCP port needs tokens (see token_file and tcp_without_tokens) "
        "and is not encrypted. Port 0: any free port; port_file then receives its number.")
SETTING(unix_users, LIST, BASIC, .reloads = true,
        .help = "Users who may read, submit and cancel on the Unix socket. They are names or numbers, "
                "separated by colons or commas. The user of the service and root are administrators. "
                "Other users cannot reach a socket in state_dir: set listen to a socket in a "
                "directory that they can reach. hexad --allow "
                "adds a user here, and opens the socket of hexad.socket.")
SETTING(unix_groups, LIST, BASIC, .reloads = true,
        .help = "Groups whose members have the same access as unix_users.")
SETTING(unix_admins, LIST, BASIC, .reloads = true, .help = "Users who are administrators on the Unix socket.")
SETTING(token_file, TEXT, BASIC,
        .help =
            "The file of bearer tokens, which hexadctl token writes. It holds only their hashes. Its mode is "
            "0600, or 0640 when it belongs to root and to the service's group. The service checks the file "
            "at every use, so a change takes effect at once. Empty: the file tokens in "
            "$CONFIGURATION_DIRECTORY (of the unit: /etc/hexad), otherwise in state_dir, if it exists.")
SETTING(tcp_without_tokens, TEXT, ADVANCED,
        .help = "Whether a loopback port is served without tokens. The only value that allows it is "
                "anyone-on-this-machine-may-submit-and-cancel, which states the effect. A port that "
                "other machines can reach is never served without tokens.")
SETTING(page_origins, WORDS, ADVANCED,
        .help =
            "Origins of web pages (https://gui.example, http://localhost:3000) that may send requests from a "
            "browser and read the answers; separated by commas, and the key may be repeated. Behind a proxy: "
            "the origin at which browsers reach it, for the page of hexad itself. A request over TCP without "
            "a token gets status 421 if its Host is neither that of this port nor of one of these origins, "
            "and 403 if it comes from a page of another origin.")
SETTING(page, INTEGER, ADVANCED, .part = BUILD_PART_PAGE, .default_text = "1", .low = 0, .high = 1,
        .help = "1: the web page is served at /, and browsers may sign in with a token. 0: neither.")
SETTING(session_s, REAL, ADVANCED, .part = BUILD_PART_PAGE, .default_text = "43200", .low = 1, .high = 3.2e7,
        .unit = "s",
        .help = "How long a browser stays signed in. A session ends earlier when its token is revoked.")
SETTING(
    trusted_proxies, WORDS, ADVANCED,
    .help =
        "Addresses or ranges (10.0.0.0/8) of proxies in front of a TCP port; separated by commas, and the "
        "key may be repeated. Their header Forwarded (RFC 7239) gives the address of the client, which is "
        "used for the limits of connections and in the log. The header is ignored if it comes from "
        "another address; X-Forwarded-For is always ignored.")
SETTING(
    port_file, TEXT, ADVANCED,
    .help = "A file that receives the served addresses, one a line, once the service listens. Empty: none.")
SETTING(state_dir, TEXT, BASIC,
        .help =
            "The directory of the queue, the attempts and the results. It is created if missing. It must be "
            "on a local file system, and only one daemon may use it. A start and --check-settings warn if "
            "other users can write to it. Empty: $STATE_DIRECTORY (set by systemd), otherwise lib/hexad "
            "below the localstatedir of the build.")
SETTING(work_dir, TEXT, ADVANCED,
        .help = "The directory of attempts, results and uploaded inputs, on storage that all nodes "
                "of a farm see at the same path. Only one service may use it. Empty: state_dir.")
SETTING(
    engine, TEXT, BASIC, .default_text = "local",
    .help =
        "What runs the attempts. local: processes of this machine. slurm: jobs of Slurm, by its commands; "
        "requires work_dir. The setting workers then has no effect, and threads and host_memory_mb are "
        "the limits of one attempt.")
SETTING(slurm_job_limit, INTEGER, ADVANCED, .part = BUILD_PART_SLURM, .default_text = "2000", .low = 1,
        .high = 100000, .unit = "attempts",
        .help = "The maximum number of attempts in the queue of Slurm. Further ones wait in the "
                "queue of hexad.")
SETTING(
    slurm_options, WORDS, ADVANCED, .part = BUILD_PART_SLURM,
    .help =
        "Further options of sbatch for all attempts, as --partition=farm, --qos=normal, --constraint=avx512; "
        "separated by commas, and the key may be repeated.")
SETTING(
    slurm_allow, WORDS, ADVANCED, .part = BUILD_PART_SLURM,
    .help =
        "The options of sbatch that a job may set (queue.slurm): with one value, such as --partition=gpu, "
        "or with any value, such as --constraint. Separated by commas, and the key may be repeated. "
        "Empty: none.")
SETTING(
    slurm_accounts, WORDS, ADVANCED, .part = BUILD_PART_SLURM,
    .help =
        "The Slurm accounts of users, as user=account; `*` stands for all users who are not named. Separated by "
        "commas, and the key may be repeated. Empty: Slurm's default.")
SETTING(
    slurm_node, TEXT, ADVANCED, .part = BUILD_PART_SLURM,
    .help =
        "The program hexad-node on the nodes. Empty: as on this host, beside hexad or in the bindir of the "
        "build. worker is a path on the nodes, too.")
SETTING(slurm_batch_points, INTEGER, RESEARCH, .part = BUILD_PART_SLURM, .default_text = "20000", .low = 0,
        .high = 1 << 30, .unit = "points",
        .help = "Attempts with at most this number of points share a Slurm job when many wait. 0: no "
                "attempts share a job.")
SETTING(slurm_batch_attempts, INTEGER, RESEARCH, .part = BUILD_PART_SLURM, .default_text = "16", .low = 1,
        .high = 1000, .unit = "attempts",
        .help = "The maximum number of these attempts in one Slurm job, which runs them in sequence.")
SETTING(slurm_batch_s, REAL, RESEARCH, .part = BUILD_PART_SLURM, .default_text = "60", .low = 0,
        .high = 86400, .unit = "s",
        .help = "How long after its start such a Slurm job takes over small attempts of other Slurm "
                "jobs that have not started. This uses nodes that are idle while Slurm starts jobs, "
                "which takes about a second each.")
SETTING(slurm_interval_s, REAL, RESEARCH, .part = BUILD_PART_SLURM, .default_text = "1", .low = 0.1,
        .high = 3600, .unit = "s",
        .help = "The interval between calls of squeue, each for all attempts; longer if squeue is slow.")
SETTING(slurm_timeout_s, REAL, RESEARCH, .part = BUILD_PART_SLURM, .default_text = "30", .low = 0.1,
        .high = 3600, .unit = "s", .help = "The time limit of a command of Slurm.")
SETTING(slurm_lost_s, REAL, RESEARCH, .part = BUILD_PART_SLURM, .default_text = "30", .low = 0, .high = 86400,
        .unit = "s",
        .help = "How long a job must be missing from Slurm, or the file that ends an attempt be "
                "unreadable, before the attempt is abandoned and tried again. While Slurm does not "
                "answer, no attempt is abandoned.")
SETTING(
    input_roots, LIST, BASIC,
    .help =
        "Input files that jobs may read: directories, with all below them, or files. They are separated by "
        "colons or commas, and the key may be repeated. Symbolic links are followed as long as they lead below one "
        "of these. Empty: jobs may read only the files that clients uploaded.")
SETTING(
    output_roots, LIST, BASIC,
    .help =
        "Directories below which a job may have its results copied (output.directory). They are written as "
        "input_roots. With DIRECTORY/%u a user may use only what is below the directory of the user's name: with "
        "/srv/out/%u, jobs of alice may use /srv/out/alice/test. Missing directories are made. Under systemd a drop-in of hexad.service names them in ReadWritePaths=, too. Empty: no "
        "results are copied.")
SETTING(path_mappings, WORDS, BASIC,
        .help =
            "Translates the paths of other machines: from=to, separated by commas. The key may be repeated. "
            "With Z:/show=/mnt/show a job that names Z:\\show\\a.vdb reads /mnt/show/a.vdb. The service maps "
            "input paths and output.directory when a job is submitted, by the longest matching `from`. When "
            "`from` begins with a drive or with \\\\, case is ignored and \\ equals /. input_roots and "
            "output_roots apply to the mapped path.")
SETTING(output_mode, TEXT, ADVANCED, .default_text = "0644",
        .help = "The mode of copied results, in octal. New directories get the same mode, with "
                "execute permission wherever there is read permission.")
SETTING(output_group, TEXT, ADVANCED, .help = "The group of copied results. Empty: the service's group.")
SETTING(
    share_outputs, INTEGER, ADVANCED, .default_text = "0", .low = 0, .high = 1,
    .help =
        "1: a job may replace the result of another user in its output.directory. 0: such a job is refused "
        "(output_taken) while the report.json that was delivered for the other user is there.")
SETTING(workers, INTEGER, BASIC, .default_text = "0", .low = 0, .high = 1024, .unit = "processes",
        .help = "The maximum number of attempts that run at once. Fewer run when threads or "
                "host_memory_mb is exhausted. 0: one per thread.")
SETTING(threads, INTEGER, BASIC, .default_text = "0", .low = 0, .high = 4096, .unit = "threads",
        .help =
            "The threads of all attempts together. A job without solver.threads gets this number divided by "
            "workers. 0: the number of processors.")
SETTING(host_memory_mb, INTEGER, BASIC, .default_text = "0", .low = 0, .high = 1 << 30, .unit = "MiB",
        .help = "The memory of all attempts together. Each attempt reserves its limit. 0: nine tenths of the "
                "machine's memory, or of the limit of the service's control group.")
SETTING(worker, TEXT, ADVANCED,
        .help =
            "The program that runs a job. Empty: hexad-worker beside hexad, otherwise in the bindir of the "
            "build.")
SETTING(memory_mb, INTEGER, BASIC, .default_text = "4096", .low = WORKER_MEMORY_LEAST_MB, .high = 1 << 24,
        .unit = "MiB", .help = "The memory limit of a job without limits.memory_mb.")
SETTING(file_mb, INTEGER, ADVANCED, .default_text = "65536", .low = 0, .high = 1 << 24, .unit = "MiB",
        .reloads = true,
        .help = "The longest file that a worker may write. 100 million points take 10 GiB. 0: no limit.")
SETTING(sandbox, SANDBOX, ADVANCED, .default_text = "available",
        .help = "How workers are isolated. required: a worker has no network and no new privileges, a filter "
                "limits its system calls, and Landlock lets it read only input_roots and write only its own "
                "directory; hexad does not start where the kernel has no Landlock. available: the same, but "
                "without Landlock where the kernel has none, which the log reports. off: no isolation.")
SETTING(timeout_s, REAL, BASIC, .default_text = "0", .low = 0, .high = 1e7, .unit = "s", .reloads = true,
        .help = "The time limit of a job without limits.timeout_s, over all its attempts. 0: no limit.")
SETTING(stall_s, REAL, ADVANCED, .default_text = "0", .low = 0, .high = 1e7, .unit = "s", .reloads = true,
        .help = "The longest time without progress from a worker, for a job without limits.stall_s. "
                "Then the worker is stopped, and the job is tried again, up to max_attempts. 0: no "
                "limit.")
SETTING(estimates, INTEGER, ADVANCED, .default_text = "2", .low = 0, .high = 1024, .unit = "processes",
        .help =
            "How many estimates run at once when clients validate specs. Each is a worker process beside the "
            "attempts, with the memory and threads of its job. Further requests get an answer without an "
            "estimate. 0: no estimates; the inputs of a validated spec are not opened.")
SETTING(estimate_timeout_s, REAL, ADVANCED, .default_text = "10", .low = 0.01, .high = 3600, .unit = "s",
        .help = "The time limit of an estimate.")
SETTING(
    thumbnail_timeout_s, REAL, RESEARCH, .default_text = "10", .low = 0.01, .high = 3600, .unit = "s",
    .help =
        "The time limit of the process that makes a thumbnail of a preview. Then the request is refused (503).")
SETTING(max_attempts, INTEGER, ADVANCED, .default_text = "3", .low = 1, .high = 100, .unit = "attempts",
        .help = "The number of attempts of a job whose worker crashes, for a job without "
                "limits.max_attempts.")
SETTING(max_files, INTEGER, ADVANCED, .default_text = "100000", .low = 1, .high = 100000, .unit = "files",
        .help = "The number of files of a data set (queue.files), each of which is a frame of its job.")
SETTING(
    max_interruptions, INTEGER, ADVANCED, .default_text = "20", .low = 0, .high = 1000000, .unit = "attempts",
    .help = "How often a stop or crash of hexad or of its host may end an attempt of a job (of an array: of "
            "a frame) before the job fails with `interrupted`. Such attempts do not count against "
            "max_attempts. 0: any number of times.")
SETTING(retry_s, REAL, ADVANCED, .default_text = "1", .low = 0, .high = 86400, .unit = "s",
        .help = "The wait before a crashed job is tried again; it doubles after each further crash.")
SETTING(retry_most_s, REAL, ADVANCED, .default_text = "300", .low = 0, .high = 86400, .unit = "s",
        .help = "The longest of these waits.")
SETTING(free_space_mb, INTEGER, ADVANCED, .default_text = "256", .low = 0, .high = 1 << 30, .unit = "MiB",
        .help =
            "The free space on the disks of state_dir that is needed to start jobs. With less, /readyz "
            "reports storage_full and jobs wait. Set it higher than the total size of the results of jobs "
            "that run at once. 0: jobs start even on a full disk.")
SETTING(
    reserve_mb, INTEGER, RESEARCH, .default_text = "16", .low = 0, .high = 1 << 20, .unit = "MiB",
    .help =
        "Disk space in state_dir that is set aside for the queue, in addition to the usual size of its "
        "log (5 MiB). On a full disk it lets users cancel and delete jobs, lets jobs end and lets hexad "
        "start. The service accepts jobs only while the same amount is free in addition. 16 MiB are enough for "
        "about 400 such changes, one after the other, until the disk has room again. 0: none.")
SETTING(
    storage_retries, INTEGER, ADVANCED, .default_text = "300", .low = 0, .high = 1000000, .unit = "attempts",
    .help = "How often a job is tried again because a disk was full (storage_full) or failed "
            "(storage_failed), including the disk of output.directory. These attempts do not count against "
            "max_attempts. The waits are retry_s, twice that and so on up to retry_most_s; with its default, "
            "300 tries take a day.")
SETTING(cache, INTEGER, ADVANCED, .default_text = "1", .low = 0, .high = 1,
        .help = "1: a job that is equal to an earlier one gets the result of that job, if it still "
                "exists and no input has changed. Sequences always run. 0: every job runs.")
SETTING(
    user_weights, WORDS, ADVANCED, .reloads = true,
    .help =
        "The shares of users while several have jobs that wait, as user:weight, from 0.01 to 100; "
        "separated by commas, and the key may be repeated. Users take turns among jobs of equal priority; "
        "each frame of an array takes a turn. With alice:2, bob:1 alice gets two turns for each of bob. "
        "`*` stands for all users who are not named, whose weight is otherwise 1. Turns do not accumulate "
        "while a user has no jobs.")
SETTING(
    user_priorities, WORDS, ADVANCED, .reloads = true,
    .help =
        "The highest priorities that users may give to jobs, as user:priority, from -1000 to 1000; "
        "written as user_weights, and `*` stands for all users who are not named. With *:0, alice:50 only "
        "alice and administrators can run a job before those of other users. A token counts as its user, "
        "and may allow less. Higher priorities are refused (priority_forbidden). Empty: users may give "
        "any.")
SETTING(
    user_queued, INTEGER, ADVANCED, .default_text = "200000", .low = 0, .high = 1 << 30, .unit = "jobs",
    .help =
        "How many unfinished jobs a user may have; further ones are refused (too_many_jobs). 0: any number.")
SETTING(
    user_tasks, INTEGER, ADVANCED, .default_text = "2000000", .low = 0, .high = 1 << 30, .unit = "tasks",
    .help =
        "How many unfinished tasks a user may have: one for each job, and one for each frame of an array. "
        "Submissions beyond them are refused (too_many_tasks). 0: any number.")
SETTING(user_running, INTEGER, ADVANCED, .default_text = "256", .low = 0, .high = 1 << 20, .unit = "attempts",
        .help = "How many attempts of a user run at once; the user's other jobs wait. 0: any number.")
SETTING(user_submissions, INTEGER, ADVANCED, .default_text = "200000", .low = 0, .high = 1 << 30,
        .unit = "jobs",
        .help = "How many jobs a user may submit in an hour; further ones are refused "
                "(too_many_submissions) with the time to wait. 0: any number.")
SETTING(
    check_interval_s, REAL, ADVANCED, .default_text = "86400", .low = 1, .high = 1e7, .or_zero = true,
    .unit = "s",
    .help =
        "The interval of complete checks of the database for damage. A check reads a copy, which is "
        "made when the queue is idle. After each start there is a quick check in addition. 0: only the quick check.")
SETTING(retention_s, REAL, BASIC, .default_text = "0", .low = 0, .high = 1e10, .unit = "s",
        .help = "How long a job and its results are kept after its end. A job may have its own "
                "queue.retention_s. Time during which the daemon is stopped does not count. 0: "
                "forever.")
SETTING(results_mb, INTEGER, BASIC, .default_text = "0", .low = 0, .high = 1 << 30, .unit = "MiB",
        .reloads = true,
        .help =
            "The maximum disk space of ended jobs, with results and logs. When it is reached, delivered jobs "
            "are deleted, in the order of their delivery, until less is used. A job is delivered when its "
            "owner has fetched each file of its results, or they were copied to output.directory, or it has "
            "none. When no job may be deleted, no job starts and new ones are refused (results_full). Jobs "
            "that are running may exceed it. 0: four fifths of the disk of work_dir.")
SETTING(
    results_count, INTEGER, ADVANCED, .default_text = "0", .low = 0, .high = 1 << 30, .unit = "results",
    .reloads = true,
    .help =
        "The same for the number of results: jobs, and frames of arrays, that succeeded, failed or timed out. "
        "0: any number.")
SETTING(user_results_mb, INTEGER, ADVANCED, .default_text = "0", .low = 0, .high = 1 << 30, .unit = "MiB",
        .reloads = true,
        .help = "results_mb for the results of each user; the jobs of others go on. 0: no bound.")
SETTING(user_results_count, INTEGER, ADVANCED, .default_text = "0", .low = 0, .high = 1 << 30,
        .unit = "results", .reloads = true,
        .help = "results_count for the results of each user. 0: any number.")
SETTING(delete_undelivered, INTEGER, ADVANCED, .default_text = "0", .low = 0, .high = 1, .reloads = true,
        .help = "1: when results have reached a bound and all delivered jobs are deleted, the other "
                "ended jobs are deleted, the oldest first. 0: only delivered jobs are deleted.")
SETTING(grace_s, REAL, ADVANCED, .default_text = "5", .low = 0, .high = 3600, .unit = "s", .reloads = true,
        .help = "The time between asking a worker to end and killing it.")
SETTING(drain_s, REAL, ADVANCED, .default_text = "30", .low = 0, .high = 1e6, .unit = "s", .reloads = true,
        .help = "After SIGTERM: how long running jobs may continue before they are stopped and queued again. "
                "Jobs of Slurm continue.")
SETTING(body_limit_bytes, INTEGER, ADVANCED, .default_text = "1048576", .low = 1, .high = 1 << 30,
        .unit = "bytes", .help = "The longest request body.")
SETTING(
    body_total_bytes, INTEGER, RESEARCH, .default_text = "0", .low = 0, .high = 1e15, .unit = "bytes",
    .help =
        "The memory for the bodies of all simultaneous requests, at least body_limit_bytes; each user may "
        "take 16 KiB in any case. 0: 16 times body_limit_bytes.")
SETTING(user_body_bytes, INTEGER, RESEARCH, .default_text = "0", .low = 0, .high = 1e15, .unit = "bytes",
        .help = "The memory for the bodies of simultaneous requests of one user, at least body_limit_bytes. "
                "0: 4 times body_limit_bytes.")
SETTING(
    answer_total_bytes, INTEGER, RESEARCH, .default_text = "67108864", .low = 16384, .high = 1e15,
    .unit = "bytes",
    .help =
        "The memory for all answers of 16 KiB and more while they are sent. Files, event streams and answers to "
        "requests that change something do not count. Each user may take 1 MiB in any case.")
SETTING(
    user_answer_bytes, INTEGER, RESEARCH, .default_text = "16777216", .low = 16384, .high = 1e15,
    .unit = "bytes",
    .help =
        "The memory for answers of 16 KiB and more while they are sent to one user, or to the clients of one "
        "address that show no token. A single answer may be longer.")
SETTING(upload_limit_bytes, INTEGER, ADVANCED, .default_text = "17179869184", .low = 0, .high = 1e15,
        .unit = "bytes",
        .help = "The longest file that a client may upload for its jobs. 0: only empty files.")
SETTING(upload_total_bytes, INTEGER, BASIC, .default_text = "137438953472", .low = 0, .high = 1e15,
        .unit = "bytes", .help = "The total size of all uploaded files, in the directory inputs of work_dir.")
SETTING(
    user_upload_bytes, INTEGER, ADVANCED, .default_text = "0", .low = 0, .high = 1e15, .unit = "bytes",
    .help =
        "The total size of the uploaded files of one user: those that are kept and those that are being sent. A "
        "file that several users have sent counts for each. 0: a quarter of upload_total_bytes.")
SETTING(user_uploads, INTEGER, ADVANCED, .default_text = "8", .low = 0, .high = 10000,
        .help = "How many files one user may send at once. 0: any number.")
SETTING(
    share_inputs, INTEGER, ADVANCED, .default_text = "0", .low = 0, .high = 1,
    .help =
        "1: a job may name a file that any user has sent. 0: its user must have sent the same bytes, or be an "
        "administrator.")
SETTING(inputs_keep_s, REAL, ADVANCED, .default_text = "604800", .low = 60, .high = 1e10, .or_zero = true,
        .unit = "s",
        .help =
            "How long an uploaded file is kept after its last use, which is an upload, the submission of a "
            "job that names it, or the start of a job that reads it. A file that an unfinished job reads is "
            "kept. 0: forever.")
SETTING(header_limit_bytes, INTEGER, RESEARCH, .default_text = "32768", .low = 4096, .high = 1 << 20,
        .unit = "bytes",
        .help = "The longest request line and headers of a request, and the longest headers of an answer.")
SETTING(
    connection_limit, INTEGER, ADVANCED, .default_text = "2048", .low = 1, .high = 100000,
    .unit = "connections",
    .help =
        "The total number of connections. For one more, the server closes the one that has been idle "
        "longest and belongs to no user. At the start it is lowered, with a warning in the log, to the number "
        "for which the limit of open files (LimitNOFILE= of the unit) suffices.")
SETTING(client_connection_limit, INTEGER, ADVANCED, .default_text = "256", .low = 1, .high = 100000,
        .unit = "connections",
        .help =
            "How many connections without a token one client may have: a client is an address on "
            "TCP, or an unknown user on the Unix socket. For one more, the server closes the one that has "
            "been idle longest.")
SETTING(user_connection_limit, INTEGER, ADVANCED, .default_text = "512", .low = 1, .high = 100000,
        .unit = "connections",
        .help = "How many connections one user may have, by token or on the Unix socket, from all addresses "
                "together.")
SETTING(admin_connections, INTEGER, RESEARCH, .default_text = "32", .low = 0, .high = 100000,
        .unit = "connections",
        .help = "How many of connection_limit are reserved for administrators, at most half of it.")
SETTING(connection_timeout_s, REAL, ADVANCED, .default_text = "30", .low = 0.1, .high = 86400, .unit = "s",
        .help = "How long a connection may be idle, and how long a client may take to send a request.")
SETTING(wait_limit_s, REAL, ADVANCED, .default_text = "60", .low = 0, .high = 3600, .unit = "s",
        .help = "The longest time that a client may have an answer wait for a change (Prefer: wait).")
SETTING(
    thread_wait_s, REAL, RESEARCH, .default_text = "30", .low = 0.01, .high = 3600, .unit = "s",
    .help =
        "How long a request may wait for a thread of the service while others are being answered. Then it is "
        "refused (503).")
SETTING(
    kept_documents, INTEGER, RESEARCH, .default_text = "4096", .low = 0, .high = 1 << 20, .unit = "documents",
    .help = "How many answers to GET /v1/jobs/ID are kept in memory, each until its job changes. An answer "
            "takes its length, usually 1 to 2 KiB; answers longer than 16 KiB are not kept. 0: none.")
SETTING(webhook_hosts, WORDS, ADVANCED,
        .help = "Hosts that jobs may notify of their end (queue.webhook): HOST, for its ports 80 and 443, or "
                "HOST:PORT; separated by commas, and the key may be repeated. Empty: jobs with webhooks are "
                "refused and none is called.")
SETTING(
    webhook_secret_file, TEXT, ADVANCED,
    .help =
        "The file of the secret that signs webhooks: of mode 0600, or 0640 as token_file, with one line, which is whsec_ and the "
        "base64 text of a key of 24 to 64 random bytes: the form that libraries of standardwebhooks.com "
        "expect. A line without whsec_, of at least 16 characters, is itself the key. webhook_hosts needs "
        "this file. Each call has the headers of Standard Webhooks: webhook-id, one for each end of a job, "
        "the same in each try and given by no other service; webhook-timestamp, the second of the try; and "
        "webhook-signature, which is \"v1,\" and the base64 text of the HMAC-SHA256 of ID.TIMESTAMP.BODY. "
        "A receiver should refuse other signatures, old timestamps and ids that it has seen.")
SETTING(webhook_calls, INTEGER, ADVANCED, .default_text = "8", .low = 1, .high = 256, .unit = "calls",
        .help = "How many webhooks are called at once, each on another host.")
SETTING(webhook_tries, INTEGER, ADVANCED, .default_text = "12", .low = 1, .high = 1000, .unit = "tries",
        .help = "The maximum number of calls of a webhook. Calls end when the status of the answer "
                "is 2xx or 410. Redirects are not followed.")
SETTING(webhook_timeout_s, REAL, ADVANCED, .default_text = "10", .low = 0.1, .high = 3600, .unit = "s",
        .help = "The time limit of a call. Other calls to the same host wait for it.")
SETTING(webhook_retry_s, REAL, ADVANCED, .default_text = "5", .low = 0.01, .high = 86400, .unit = "s",
        .help = "The wait before a failed call is repeated; it doubles after each further failure.")
SETTING(webhook_retry_most_s, REAL, ADVANCED, .default_text = "3600", .low = 0.01, .high = 1e6, .unit = "s",
        .help = "The longest of these waits.")
SETTING(webhook_retry_after_s, REAL, ADVANCED, .default_text = "86400", .low = 0, .high = 1e6, .unit = "s",
        .help =
            "The longest wait that a receiver may ask for by Retry-After in an answer with the status 429 or "
            "503. The next try waits at least that long. 0: the header is ignored.")
SETTING(log_level, LEVEL, BASIC, .default_text = "info", .reloads = true,
        .help = "The lowest level of logged messages: error, warning, info or debug.")
