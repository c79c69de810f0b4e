// SPDX-License-Identifier: Apache-2.0
/* words: derives an enumeration and its words from one list, so that they always agree.
 *
 * A list is a macro NAME_LIST(ENTRY, prefix) with lines ENTRY(prefix, NAME, "word"). The macros below derive
 * the enumerators prefix_NAME and the words, in the same order. A table that maps one enumeration to another
 * is derived from the same list with another ENTRY: if the other enumeration lacks a word, it does not
 * compile.
 */
#ifndef HEXAD_BASE_CORE_WORDS_H
#define HEXAD_BASE_CORE_WORDS_H

#define WORDS_ENUMERATOR(prefix, name, word) prefix##_##name,
#define WORDS_TEXT(prefix, name, word) word,

#endif
