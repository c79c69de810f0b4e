/* descriptors: what the daemon sets of its file descriptors before anything else. Called once, in main. */
#ifndef HEXAD_PROGRAMS_DESCRIPTORS_H
#define HEXAD_PROGRAMS_DESCRIPTORS_H

/* Opens standard descriptors that are closed, and raises the limit of open files. */
void descriptors_prepare(void);

#endif
