# Completion of hexad, hexadctl and hexad-worker in bash: by what their --help says, so that nothing is missing, and of ids by
# what the server lists.

# The words that --help gives for --state.
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
    help=$("${COMP_WORDS[0]}" --help 2>/dev/null) || return
    if [[ $word == -* ]]; then
        words=$(grep -oE -e '--[a-z][a-z_-]*' <<<"$help")
    elif [[ ${COMP_WORDS[COMP_CWORD - 1]} == --state ]]; then
        words=$(_hexad_states "$help")
        [[ $word != *,* ]] || before=${word%,*},
    elif [[ $typed =~ ^[a-z\ -]*$ ]]; then
        # the lines of commands, and of them what may follow the words that are there
        words=$(sed -nE 's/^  ([a-z].*)/\1/p; s/^([Uu]sage:)? +hexad-worker ([a-z])/\2/p' <<<"$help" |
            sed -E 's/  .*//; s/, /\n/g' |
            sed -nE "s/^${typed:+$typed }([a-z][a-z-]*)( .*)?\$/\\1/p")
    fi
    [[ $words || $word == -* || ! $typed ]] || words=$(_hexad_ids "${COMP_WORDS[0]}" "${COMP_WORDS[1]}" "$help")
    mapfile -t COMPREPLY < <(compgen -P "$before" -W "$words" -- "${word#"$before"}" | sort -u)
}

complete -o default -F _hexad hexad hexadctl hexad-worker
