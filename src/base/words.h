/* words: an enumeration and its words out of one list, so that they cannot part.
 *
 * A list is a macro NAME_LIST(ENTRY, prefix) of lines ENTRY(prefix, NAME, "word"). The macros below make of it the
 * enumerators prefix_NAME and the words, in the same order. Whoever maps one enumeration to another makes the table
 * of the same list, with an ENTRY of its own: a word that one of them lacks does not compile.
 */
#ifndef HEXAD_BASE_WORDS_H
#define HEXAD_BASE_WORDS_H

#define WORDS_ENUMERATOR(prefix, name, word) prefix##_##name,
#define WORDS_TEXT(prefix, name, word) word,

#endif
