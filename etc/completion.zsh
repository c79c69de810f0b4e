#compdef hexad hexadctl hexad-worker
# Completion in zsh: by what the help says and the server lists, as completion.bash has it.

local help before= typed="${(j: :)words[2,CURRENT-1]}" ids
local -aU offered
help=$(${(Q)~words[1]} --help all 2>/dev/null) || return 1
[[ $words[CURRENT] == *[a-z]* || ( $words[CURRENT] != -* && -n $typed ) || $words[CURRENT-1] == --state ]] || help=$(${(Q)~words[1]} --help)
if [[ $words[CURRENT] == -* ]]; then
    offered=(${(f)"$(grep -oE -e '--[a-z][a-z_-]*' <<<$help)"})
elif [[ $words[CURRENT-1] == --state ]]; then
    [[ $words[CURRENT] != *,* ]] || before=${words[CURRENT]%,*},
    offered=($before${^=$(sed -nE '/^  --state STATES/,/several/ { s/--state STATES|; several.*|,//g; s/ or( |$)/ /; p; }' <<<$help)})
elif [[ $typed =~ '^[a-z -]*$' ]]; then
    # the lines of commands, and of them what may follow the words that are there
    offered=(${(f)"$(sed -nE 's/^  ([a-z].*)/\1/p' <<<$help | sed -E 's/  .*//' | sed -nE "s/^${typed:+$typed }([a-z][a-z-]*)( .*)?\$/\\1/p")"})
fi
if (( ! $#offered )) && [[ $words[CURRENT] != -* && -n $typed ]] && grep -qE "^  $words[2] \[?ID" <<<$help; then
    ids=$(timeout "${HEXAD_COMPLETION_S:-1}" ${(Q)~words[1]} list --limit 100 2>/dev/null | sed -n '2,$s/ .*//p')
    [[ -z $ids ]] || offered=(latest ${(f)ids})
fi
if (( $#offered )); then compadd -- $offered; else _files; fi
