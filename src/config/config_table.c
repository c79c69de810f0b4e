#include "config/config_table.h"

#include "config/config.h"

#define AT(member) offsetof(config, member), false
#define RELOADS(member) offsetof(config, member), true

const config_row config_table[] = {
    {"listen", CONFIG_TEXT, "127.0.0.1:8642", 0, 0, "",
     "Where to serve: HOST:PORT or unix:/path. There is no authentication yet, so only loopback"
     " addresses are accepted. Port 0 takes a free one, see port_file.",
     AT(listen)},
    {"port_file", CONFIG_TEXT, "", 0, 0, "",
     "A file that is given the address actually served, in one line, once it is. Empty: none.",
     AT(port_file)},
    {"state_dir", CONFIG_TEXT, "", 0, 0, "",
     "Directory of the queue, the attempts and the results; made when missing. On a local file"
     " system, and of one daemon only. Empty: $STATE_DIRECTORY (of systemd), else lib/hexad"
     " below the localstatedir of the build.",
     AT(state_dir)},
    {"input_roots", CONFIG_LIST, "", 0, 0, "",
     "Directories below which a job may name input files, separated by colons or commas; the key"
     " may be repeated. Empty: no job may read a file.",
     AT(input_roots)},
    {"workers", CONFIG_INTEGER, "0", 0, 1024, "processes",
     "Jobs that run at once. 0: one per core.", AT(workers)},
    {"worker", CONFIG_TEXT, "", 0, 0, "",
     "The program that runs a job. Empty: hexad-worker beside hexad, else in the bindir of the "
     "build.",
     AT(worker)},
    {"memory_mb", CONFIG_INTEGER, "4096", 16, 1 << 24, "MiB",
     "Memory of a job that names no limit.", RELOADS(memory_mb)},
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
     "Time of an attempt of a job that names no limit. 0: none.", RELOADS(timeout_s)},
    {"stall_s", CONFIG_REAL, "0", 0, 1e7, "s",
     "How long a worker may report no progress, of a job that names no limit. 0: for ever.",
     RELOADS(stall_s)},
    {"max_attempts", CONFIG_INTEGER, "3", 1, 100, "attempts",
     "How often a job whose worker crashes is tried, of a job that names no number.",
     AT(max_attempts)},
    {"grace_s", CONFIG_REAL, "5", 0, 3600, "s", "Between asking a worker to end and killing it.",
     RELOADS(grace_s)},
    {"drain_s", CONFIG_REAL, "30", 0, 1e6, "s",
     "At SIGTERM: how long running jobs may go on before they are put back in the queue.",
     RELOADS(drain_s)},
    {"body_limit_bytes", CONFIG_INTEGER, "1048576", 1, 1 << 30, "bytes", "Longest request body.",
     AT(body_limit_bytes)},
    {"connection_limit", CONFIG_INTEGER, "256", 1, 100000, "connections", "Connections at once.",
     AT(connection_limit)},
    {"connection_timeout_s", CONFIG_REAL, "30", 0.1, 86400, "s",
     "How long a connection may be idle, and how long a client may take to send a request.",
     AT(connection_timeout_s)},
    {"log_level", CONFIG_LEVEL, "info", 0, 0, "", "error, warning, info or debug.", RELOADS(log_level)},
};

const size_t config_table_size = sizeof config_table / sizeof *config_table;
