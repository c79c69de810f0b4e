# Completion of hexad, hexadctl and hexad-worker in bash: by what their --help says, so that nothing is missing.

_hexad() {
    local word=${COMP_WORDS[COMP_CWORD]} typed=${COMP_WORDS[*]:1:COMP_CWORD-1} help words
    help=$("${COMP_WORDS[0]}" --help 2>/dev/null) || return
    if [[ $word == -* ]]; then
        words=$(grep -oE -e '--[a-z][a-z_-]*' <<<"$help")
    elif [[ $typed =~ ^[a-z\ -]*$ ]]; then
        # the lines of commands, and of them what may follow the words that are there
        words=$(sed -nE 's/^  ([a-z].*)/\1/p; s/^([Uu]sage:)? +hexad-worker ([a-z])/\2/p' <<<"$help" |
            sed -E 's/  .*//; s/, /\n/g' |
            sed -nE "s/^${typed:+$typed }([a-z][a-z-]*)( .*)?\$/\\1/p")
    fi
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$word" | sort -u)
}

complete -o default -F _hexad hexad hexadctl hexad-worker
