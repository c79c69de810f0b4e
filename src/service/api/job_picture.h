// SPDX-License-Identifier: Apache-2.0
/* job_picture: the handler that sends one picture of a job: for an array a contact sheet of the previews of
 * its frames, for another job its preview.
 *
 * hexad-worker makes the thumbnail of each preview in a separate process (io/pictures/thumbnail), so the
 * daemon decodes no file of a worker. A sheet is drawn at each request and has at most CONTACT_SHEET_MOST
 * frames, at equal distances in the list of succeeded frames.
 */
#ifndef HEXAD_SERVICE_API_JOB_PICTURE_H
#define HEXAD_SERVICE_API_JOB_PICTURE_H

#include "service/api/context.h"

http_handler job_picture_send;

#endif
