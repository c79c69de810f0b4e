#compdef hexad hexadctl hexad-worker
# Completion in zsh: by what --help says, as completion.bash has it.

local help typed="${(j: :)words[2,CURRENT-1]}"
local -aU offered
help=$(${(Q)~words[1]} --help 2>/dev/null) || return 1
if [[ $words[CURRENT] == -* ]]; then
    offered=(${(f)"$(grep -oE -e '--[a-z][a-z_-]*' <<<$help)"})
elif [[ $typed =~ '^[a-z -]*$' ]]; then
    # the lines of commands, and of them what may follow the words that are there
    offered=(${(f)"$(sed -nE 's/^  ([a-z].*)/\1/p; s/^([Uu]sage:)? +hexad-worker ([a-z])/\2/p' <<<$help |
        sed -E 's/  .*//; s/, /\n/g' |
        sed -nE "s/^${typed:+$typed }([a-z][a-z-]*)( .*)?\$/\\1/p")"})
fi
if (( $#offered )); then compadd -- $offered; else _files; fi
