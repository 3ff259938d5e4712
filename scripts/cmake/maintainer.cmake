# SPDX-License-Identifier: Apache-2.0
# default_maintainer(OUT SOURCE): who builds the packages maintains them: Debian's environment variables, else the user of git in the
# folder SOURCE, else nobody in particular. OUT is set to "NAME <ADDRESS>".
function(default_maintainer out source)
  set(name "$ENV{DEBFULLNAME}")
  set(address "$ENV{DEBEMAIL}")
  if(NOT (name AND address))
    foreach(key name email)
      execute_process(COMMAND git -C "${source}" config "user.${key}" OUTPUT_VARIABLE git_${key} OUTPUT_STRIP_TRAILING_WHITESPACE
        ERROR_QUIET)
    endforeach()
    set(name "${git_name}")
    set(address "${git_email}")
  endif()
  if(NOT (name AND address))
    set(name "The Trocar developers")
    set(address "trocar@example.org")
  endif()
  set(${out} "${name} <${address}>" PARENT_SCOPE)
endfunction()
