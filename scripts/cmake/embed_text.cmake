# SPDX-License-Identifier: Apache-2.0
# trocar_embed_text(TARGET FILE NAME): makes the text of FILE, a path in the calling CMake list's folder, the constant
# trocar::NAME. Sources of TARGET include it as "embedded/FILE.h", with FILE's path from the project's top folder. CMake runs
# again when FILE changes.
function(trocar_embed_text target file name)
  file(RELATIVE_PATH path ${CMAKE_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR}/${file})
  file(READ ${file} text)
  configure_file(${CMAKE_SOURCE_DIR}/scripts/cmake/embedded_text.h.in ${CMAKE_BINARY_DIR}/include/embedded/${path}.h @ONLY)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/${path})
  target_include_directories(${target} PRIVATE ${CMAKE_BINARY_DIR}/include)
endfunction()
