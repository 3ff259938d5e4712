# SPDX-License-Identifier: Apache-2.0
# bash completion for trocar-mesh, trocar-sample-ct, trocar-run, trocar-device-sim and trocar-console. Options, subcommands
# and choices are read from the program's own --help.

_trocar() {
    local cur prev words cword
    _init_completion -s || return
    local program=${1/#\~/$HOME} subcommand= word
    local subcommands=$("$program" --help 2>/dev/null | sed -n '/^Subcommands:/,$ s/^  \([a-z][a-z-]*\) .*/\1/p')
    for word in "${words[@]:1:cword-1}"; do
        [[ " $(echo $subcommands) " == *" $word "* ]] && subcommand=$word && break
    done
    local help=$("$program" $subcommand --help 2>/dev/null)

    # Values: the choices that the help names (a|b behind the option), else what the option takes.
    if [[ $prev == -* ]]; then
        local choices=$(sed -n "s/^ *\(-[a-z],\)\?$prev \([a-z-]*|[a-z|-]*\).*/\2/p" <<<"$help")
        if [[ -n $choices ]]; then
            COMPREPLY=($(compgen -W "${choices//|/ }" -- "$cur"))
            return
        fi
        case $prev in
            --passivity) COMPREPLY=($(compgen -W "on off" -- "$cur")) ;;  # a diagnostic, which --help leaves out
            --device) COMPREPLY=($(compgen -W "inproc $([[ $program == *console ]] && echo sim || echo udp:)" -- "$cur")) ;;
            --force-law) COMPREPLY=($(compgen -W "hooke network cutting" -- "$cur")) ;;
            --asset) _filedir glb ;;
            --names) COMPREPLY=($(compgen -W "verse totalsegmentator" -- "$cur")) && _filedir json ;;
            --hu | --only) _filedir ;;
            --black-box | --page) _filedir -d ;;
            --procedure) COMPREPLY=($(compgen -W "pedicle-probe jamshidi-8g vertebroplasty-11g bone-marrow-trephine spinal-needle tuohy-needle" -- "$cur")) ;;
            --recording) _filedir csv ;;
            --scene) _filedir json ;;
            --igtl) COMPREPLY=($(compgen -W "18944" -- "$cur")) ;;
            --attach) _filedir ;;
            --against) if [[ $program == *console ]]; then _filedir csv; else _filedir -d; fi ;;
            -o | --output) if [[ $subcommand == export || $subcommand == batch ]]; then _filedir -d; elif [[ $subcommand == preview ]]; then _filedir '@(png|html)'; elif [[ $subcommand == review ]]; then _filedir html; else _filedir glb; fi ;;
            --record | --replay | --report | --summary | --meshes | --frames | --key-file | \
                --device-description | --dump-stages) _filedir ;;
        esac
        [[ ${COMPREPLY[0]:-} == *: ]] && compopt -o nospace
        # Any other option with a value: nothing to offer.
        grep -qE -- "^ *(-[a-z],)?$prev(,--[a-z-]+)? [^ ]" <<<"$help" && return
    fi
    if [[ $cur == -* ]]; then
        COMPREPLY=($(compgen -W '$(_parse_help - <<<"$help" | sort -u)' -- "$cur"))
        return
    fi
    case ${program##*/} in
        trocar-mesh)
            if [[ $subcommand == list || $subcommand == review ]]; then
                _filedir -d
            elif [[ $subcommand == preview ]]; then
                _filedir
            elif [[ $subcommand == batch ]]; then
                _filedir json
            elif [[ -n $subcommand ]]; then
                _filedir glb
            else
                ((cword == 1)) && COMPREPLY=($(compgen -W "$subcommands" -- "$cur"))
                _filedir  # adds to them
            fi
            ;;
        trocar-sample-ct | trocar-console) _filedir -d ;;
        *) _filedir json ;;
    esac
} && complete -F _trocar trocar-mesh trocar-sample-ct trocar-run trocar-device-sim trocar-console
