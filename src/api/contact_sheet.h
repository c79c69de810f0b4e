/* contact_sheet: the handler of the picture of a job: the previews of all frames of an array as one picture, or the preview
 * of another job.
 *
 * hexad-worker makes a thumbnail of each preview, in a process that reads nothing else (formats/thumbnail), so the daemon
 * decodes no file. A sheet is drawn for each request; it has at most CONTACT_SHEET_MOST frames, evenly chosen.
 */
#ifndef HEXAD_API_CONTACT_SHEET_H
#define HEXAD_API_CONTACT_SHEET_H

#include "api/context.h"

http_handler contact_sheet_send;

#endif
