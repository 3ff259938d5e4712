#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# completion_test.sh COMPLETION PROGRAMS: what bash offers after a line's words. Exit 77 (skipped)
# where bash-completion is not installed.
completion=$(realpath "$1")
PATH=$(realpath "$2"):$PATH
[[ -f /usr/share/bash-completion/bash_completion ]] || exit 77
source /usr/share/bash-completion/bash_completion
source "$completion"
work=$(mktemp -d) && trap 'rm -rf "$work"' EXIT
cd "$work" && touch bone.glb scene.json && mkdir scan
failed=0

# offers WORDS... -- OFFERED...: completing the last of WORDS offers each of OFFERED; a word after
# '!' must not be offered.
offers() {
  COMP_WORDS=()
  while [[ $1 != -- ]]; do COMP_WORDS+=("$1") && shift; done
  shift
  COMP_LINE="${COMP_WORDS[*]}" COMP_POINT=${#COMP_LINE} COMP_CWORD=$((${#COMP_WORDS[@]} - 1)) COMPREPLY=()
  compopt() { :; }  # only within a completion of readline
  _trocar "${COMP_WORDS[0]}" "${COMP_WORDS[-1]}" "${COMP_WORDS[-2]}"
  local word
  [[ $(printf '%s\n' "${COMPREPLY[@]}" | sort | uniq -d) ]] && echo "FAILED: '$COMP_LINE' offers a word twice" && failed=1
  for word; do
    if [[ $word == !* ]]; then
      [[ " ${COMPREPLY[*]} " != *" ${word#!} "* ]] && continue
    else
      [[ " ${COMPREPLY[*]} " == *" $word "* ]] && continue
    fi
    echo "FAILED: '$COMP_LINE': $word; offered: ${COMPREPLY[*]}"
    failed=1
  done
}

offers trocar-mesh ver -- verify '!info'
offers trocar-mesh '' -- verify info export scan
offers trocar-mesh li -- list
offers trocar-mesh list '' -- scan '!bone.glb'
offers trocar-mesh batch '' -- scene.json '!bone.glb'
offers trocar-mesh batch -o '' -- scan '!scene.json'
offers trocar-mesh review '' -- scan '!scene.json'
offers trocar-mesh review scan -o '' -- '!scene.json'
offers trocar-mesh list --j -- --json '!--jobs'
offers trocar-mesh --t -- --threshold --tolerance '!--slices'
offers trocar-mesh verify --j -- --json '!--jobs'
offers trocar-mesh verify '' -- bone.glb '!scene.json'
offers trocar-mesh scan --contour '' -- subpixel pixel
offers trocar-mesh scan --axis c -- coronal '!sagittal'
offers trocar-run '' -- scene.json '!bone.glb'
offers trocar-run scene.json --procedure tu -- tuohy-needle
offers trocar-run scene.json --force-law '' -- hooke network
offers trocar-run scene.json --re -- --record --replay --recover
offers trocar-run scene.json --check --st -- --strict
offers trocar-run scene.json --asset '' -- bone.glb
offers trocar-run --rate '' -- '!scene.json' '!scan'
offers trocar-mesh export bone.glb -o '' -- scan '!bone.glb'
offers trocar-mesh scan -o '' -- bone.glb '!scene.json'
offers trocar-device-sim --mo -- --model
exit $failed
