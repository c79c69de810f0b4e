# Completion of hexad, hexadctl and hexad-worker in bash, by what their help says: of an empty word the basic commands and
# options, of a word with a letter all; and of ids by what the server lists.

# The words that the help gives for --state.
_hexad_states() {
    sed -nE '/^  --state STATES/,/several/ { s/--state STATES|; several.*|,//g; s/ or( |$)/ /; p; }' <<<"$1"
}

# The newest jobs, where the command, the second argument, takes the ID of one. The server has HEXAD_COMPLETION_S seconds, or one.
_hexad_ids() {
    local ids
    grep -qE "^  $2 \[?ID" <<<"$3" || return
    ids=$(timeout "${HEXAD_COMPLETION_S:-1}" "$1" list --limit 100 2>/dev/null | sed -n '2,$s/ .*//p')
    [[ ! $ids ]] || printf '%s\n' latest "$ids"
}

_hexad() {
    local word=${COMP_WORDS[COMP_CWORD]} typed=${COMP_WORDS[*]:1:COMP_CWORD-1} help words before=
    help=$("${COMP_WORDS[0]}" --help all 2>/dev/null) || return
    if [[ $word == -* ]]; then
        [[ $word == *[a-z]* ]] || help=$("${COMP_WORDS[0]}" --help)
        words=$(grep -oE -e '--[a-z][a-z_-]*' <<<"$help")
    elif [[ ${COMP_WORDS[COMP_CWORD - 1]} == --state ]]; then
        words=$(_hexad_states "$help")
        [[ $word != *,* ]] || before=${word%,*},
    elif [[ $typed =~ ^[a-z\ -]*$ ]]; then
        # the lines of commands, and of them what may follow the words that are there
        [[ $word$typed ]] || help=$("${COMP_WORDS[0]}" --help)
        words=$(sed -nE 's/^  ([a-z].*)/\1/p' <<<"$help" | sed -E 's/  .*//' | sed -nE "s/^${typed:+$typed }([a-z][a-z-]*)( .*)?\$/\\1/p")
    fi
    [[ $words || $word == -* || ! $typed ]] || words=$(_hexad_ids "${COMP_WORDS[0]}" "${COMP_WORDS[1]}" "$help")
    mapfile -t COMPREPLY < <(compgen -P "$before" -W "$words" -- "${word#"$before"}" | sort -u)
}

complete -o default -F _hexad hexad hexadctl hexad-worker
