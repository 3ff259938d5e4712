# SPDX-License-Identifier: Apache-2.0
# `cmake --install` and `cpack`: five components, each a Debian package.
#   trocar-mesh          the pipeline's program (GPL-3.0-or-later)
#   trocar-sample-ct     the sample scan's program, apart because its PNG writer needs far more libraries
#   trocar-runtime       trocar-run, trocar-device-sim, scenes, device description (Apache-2.0)
#   trocar-console       trocar-console and its page with the libraries that scripts/setup console fetches (Apache-2.0)
#   trocar-formats-dev   headers, library and CMake files for programs that read assets (Apache-2.0)
# Package files are made by scripts/package.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(share ${CMAKE_INSTALL_DATADIR}/trocar)

# --- programs, man pages, completion ----------------------------------------------------------
find_program(HELP2MAN help2man)
if(NOT HELP2MAN)
  message(STATUS "help2man is not here: no man pages (Debian's package help2man)")
endif()
# trocar_program(TARGET COMPONENT): installs the program, and a man page made from its --help.
function(trocar_program target component)
  install(TARGETS ${target} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT ${component})
  if(HELP2MAN)
    set(page ${CMAKE_BINARY_DIR}/man/${target}.1.gz)
    add_custom_command(OUTPUT ${page}
      COMMAND ${CMAKE_SOURCE_DIR}/scripts/lib/man_page $<TARGET_FILE:${target}> ${PROJECT_VERSION} ${page}
      DEPENDS ${target} ${CMAKE_SOURCE_DIR}/scripts/lib/man_page VERBATIM)
    add_custom_target(${target}-man ALL DEPENDS ${page})
    install(FILES ${page} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT ${component})
  endif()
  install(FILES ${CMAKE_SOURCE_DIR}/scripts/lib/completion.bash RENAME ${target}
    DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions COMPONENT ${component})
endfunction()
trocar_program(trocar-mesh trocar-mesh)
trocar_program(trocar-sample-ct trocar-sample-ct)
trocar_program(trocar-run trocar-runtime)
trocar_program(trocar-device-sim trocar-runtime)
trocar_program(trocar-console trocar-console)

# --- data ---------------------------------------------------------------------------------------
# The scenes name the demo's asset; --asset names another, as the man page says.
install(DIRECTORY runtime/scenes DESTINATION ${share} COMPONENT trocar-runtime FILES_MATCHING PATTERN *.json)
install(FILES runtime/device/four_legs.json DESTINATION ${share}/device COMPONENT trocar-runtime)
install(FILES formats/session/scene.schema.json formats/session/device.schema.json formats/session/summary.schema.json
  formats/session/frames.schema.json formats/session/sheets.schema.json formats/session/session_report.schema.json
  DESTINATION ${share}/schemas COMPONENT trocar-runtime)
install(FILES formats/session/list.schema.json formats/session/preview.schema.json formats/session/info.schema.json
  formats/session/report.schema.json formats/session/collection.schema.json
  formats/session/review.schema.json
  DESTINATION ${share}/schemas COMPONENT trocar-mesh)
# The page; vendor/ is there once scripts/setup console has run, as scripts/package makes sure.
install(DIRECTORY runtime/console/page/ DESTINATION ${share}/console COMPONENT trocar-console
  FILES_MATCHING PATTERN *.html PATTERN *.js PATTERN *.css PATTERN LICENSE.* PATTERN node_modules EXCLUDE)
install(FILES runtime/console/protocol.md
  DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/trocar-console COMPONENT trocar-console)
install(FILES formats/session/device_link.md formats/session/telemetry.md
  DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/trocar-runtime COMPONENT trocar-runtime)
# The head CT of the tutorial, from Debian's invesalius-examples.
install(FILES scripts/lib/head_ct.py DESTINATION ${share} COMPONENT trocar-mesh)
install(FILES pipeline/farm/store.md DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/trocar-mesh COMPONENT trocar-mesh)
install(FILES TUTORIAL.md docs/wrong-uses.md DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/trocar-mesh COMPONENT trocar-mesh)

# --- the library of formats -----------------------------------------------------------------------
target_compile_features(trocar_formats PUBLIC cxx_std_20)
target_include_directories(trocar_formats INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/trocar>)
set_target_properties(trocar_formats PROPERTIES EXPORT_NAME formats OUTPUT_NAME trocar-formats)
add_library(Trocar::formats ALIAS trocar_formats)
set(config ${CMAKE_INSTALL_LIBDIR}/cmake/Trocar)
install(TARGETS trocar_formats EXPORT trocar_formats_targets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT trocar-formats-dev)
install(EXPORT trocar_formats_targets NAMESPACE Trocar:: FILE trocar-formats-targets.cmake
  DESTINATION ${config} COMPONENT trocar-formats-dev)
# Not the codec's own headers, which include tinygltf, Draco or nlohmann/json.
install(DIRECTORY formats/base formats/geometry formats/asset formats/session
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/trocar/formats COMPONENT trocar-formats-dev
  FILES_MATCHING PATTERN *.h PATTERN gltf*.h EXCLUDE PATTERN slice_payload.h EXCLUDE
  PATTERN draco_settings.h EXCLUDE PATTERN decode_surfaces.h EXCLUDE PATTERN stated_entries.h EXCLUDE
  PATTERN scene_readers.h EXCLUDE PATTERN telemetry_layout.h EXCLUDE PATTERN recording_fields.h EXCLUDE
  PATTERN json_text.h EXCLUDE PATTERN strict_json.h EXCLUDE
  # Their code is in libraries of their own, which are not installed.
  PATTERN command_line.h EXCLUDE PATTERN device_protocol.h EXCLUDE)
install(FILES formats/asset/asset.md
  DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/trocar-formats-dev COMPONENT trocar-formats-dev)
install(FILES formats/examples/CMakeLists.txt formats/examples/list_slices.cpp formats/examples/README.md
  DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/trocar-formats-dev/examples COMPONENT trocar-formats-dev)
configure_package_config_file(scripts/cmake/TrocarConfig.cmake.in ${CMAKE_BINARY_DIR}/TrocarConfig.cmake
  INSTALL_DESTINATION ${config})
write_basic_package_version_file(${CMAKE_BINARY_DIR}/TrocarConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/TrocarConfig.cmake ${CMAKE_BINARY_DIR}/TrocarConfigVersion.cmake
  DESTINATION ${config} COMPONENT trocar-formats-dev)

# --- licences and changes, as Debian wants them -----------------------------------------------------------------
add_custom_command(OUTPUT ${CMAKE_BINARY_DIR}/changelog.gz
  COMMAND gzip -9nc ${CMAKE_SOURCE_DIR}/CHANGELOG.md > ${CMAKE_BINARY_DIR}/changelog.gz
  DEPENDS CHANGELOG.md)
add_custom_target(trocar-changelog ALL DEPENDS ${CMAKE_BINARY_DIR}/changelog.gz)
foreach(package trocar-mesh trocar-sample-ct trocar-runtime trocar-console trocar-formats-dev)
  install(FILES scripts/debian/${package}.copyright RENAME copyright
    DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package} COMPONENT ${package})
  if(package STREQUAL trocar-mesh)
    install(FILES pipeline/LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package} COMPONENT ${package})
  else()
    install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package} COMPONENT ${package})
  endif()
  install(FILES ${CMAKE_BINARY_DIR}/changelog.gz
    DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package} COMPONENT ${package})
endforeach()

# --- Debian packages ----------------------------------------------------------------------------------
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_VENDOR "Trocar")
set(CPACK_PACKAGE_CONTACT "The Trocar developers <trocar@localhost>" CACHE STRING "Who maintains the packages")
set(CPACK_STRIP_FILES ON)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_COMPONENTS_ALL trocar-mesh trocar-sample-ct trocar-runtime trocar-console trocar-formats-dev)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(for_training "For training and simulation, not for planning or guiding a treatment.")
function(trocar_package name section summary text)
  string(TOUPPER ${name} upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${name} PARENT_SCOPE)
  set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION ${section} PARENT_SCOPE)
  set(CPACK_DEBIAN_${upper}_DESCRIPTION "${summary}\n${text}\n${for_training}" PARENT_SCOPE)
endfunction()
trocar_package(trocar-mesh science "CT scans to exact triangle meshes of bone, one a slice"
  "trocar-mesh turns images, DICOM or NIfTI into a verified glTF/Draco asset.")
trocar_package(trocar-sample-ct science "a sample CT scan of a lumbar vertebra"
  "trocar-sample-ct writes a phantom of a lumbar vertebra as PNG, DICOM and NIfTI.")
trocar_package(trocar-runtime science "haptic rendering of a needle or trocar going through bone"
  "trocar-run loads assets, renders the force of a puncture and drives a\nhaptic device; trocar-device-sim simulates the device.")
trocar_package(trocar-console science "the operator's console of a puncture simulator"
  "trocar-console serves a page on this machine that starts, shows and commands\nsessions of trocar-run, and plays their recordings.")
trocar_package(trocar-formats-dev libdevel "library to read and write Trocar's mesh assets"
  "Headers, static library and CMake package Trocar, component formats.")
set(CPACK_DEBIAN_TROCAR-MESH_PACKAGE_SUGGESTS "python3-nibabel, invesalius-examples, trocar-runtime, trocar-sample-ct")
set(CPACK_DEBIAN_TROCAR-RUNTIME_PACKAGE_SUGGESTS "trocar-mesh, trocar-console")
set(CPACK_DEBIAN_TROCAR-CONSOLE_PACKAGE_DEPENDS "trocar-runtime (= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_TROCAR-CONSOLE_PACKAGE_SUGGESTS "chromium | firefox-esr")
set(CPACK_DEBIAN_TROCAR-FORMATS-DEV_PACKAGE_DEPENDS "libdraco-dev, libeigen3-dev, zlib1g-dev")
set(CPACK_DEBIAN_TROCAR-FORMATS-DEV_PACKAGE_SHLIBDEPS OFF)
include(CPack)
