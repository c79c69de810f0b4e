/* descriptors: prepares the file descriptors of the daemon. Called once, first in main. */
#ifndef HEXAD_PROGRAMS_DESCRIPTORS_H
#define HEXAD_PROGRAMS_DESCRIPTORS_H

/* Opens closed standard descriptors, and raises the limit of open files. */
void descriptors_prepare(void);

#endif
