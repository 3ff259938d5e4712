# SPDX-License-Identifier: Apache-2.0
# `cmake --install` and `cpack`: seven components, each a Debian package.
# trocar-mesh the pipeline's program (GPL-3.0-or-later)
# trocar-sample-ct the sample scan's program (Apache-2.0)
# trocar-runtime trocar-run, trocar-device-sim, device description, realtime rights (Apache-2.0)
# trocar-tools trocar-fit and trocar-hdf5, in Python (Apache-2.0)
# trocar-console trocar-console and the page with the libraries that scripts/setup console fetches (Apache-2.0)
# trocar-examples scenes with their assets (Apache-2.0)
# trocar-formats-dev headers, library and CMake files for programs that read assets (Apache-2.0)
# Package files are made by scripts/package.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(share ${CMAKE_INSTALL_DATADIR}/trocar)

# --- programs, man pages, completion ----------------------------------------------------------
find_program(HELP2MAN help2man)
if(NOT HELP2MAN)
  message(STATUS "help2man is not here: no man pages (Debian's package help2man)")
endif()
# trocar_man_page(NAME COMPONENT PROGRAM [FILE...]): a man page made from the --help of the program, which the files belong to.
function(trocar_man_page name component program)
  if(HELP2MAN)
    set(page ${CMAKE_BINARY_DIR}/man/${name}.1.gz)
    add_custom_command(OUTPUT ${page}
      COMMAND ${CMAKE_SOURCE_DIR}/scripts/lib/man_page ${name} ${program} ${PROJECT_VERSION} ${page}
      DEPENDS ${program} ${ARGN} ${CMAKE_SOURCE_DIR}/scripts/lib/man_page VERBATIM)
    add_custom_target(${name}-man ALL DEPENDS ${page})
    install(FILES ${page} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT ${component})
  endif()
endfunction()
# trocar_program(TARGET COMPONENT): installs the program, its man page and its completion.
function(trocar_program target component)
  install(TARGETS ${target} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT ${component})
  trocar_man_page(${target} ${component} $<TARGET_FILE:${target}>)
  install(FILES ${CMAKE_SOURCE_DIR}/scripts/lib/completion.bash RENAME ${target}
    DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions COMPONENT ${component})
endfunction()
trocar_program(trocar-mesh trocar-mesh)
trocar_program(trocar-sample-ct trocar-sample-ct)
trocar_program(trocar-run trocar-runtime)
trocar_program(trocar-device-sim trocar-runtime)
trocar_program(trocar-console trocar-console)
# The Python tools. A link finds its modules in the folder of the file that it leads to.
foreach(tool fit hdf5)
  file(MAKE_DIRECTORY ${CMAKE_RUNTIME_OUTPUT_DIRECTORY} ${CMAKE_BINARY_DIR}/tools)
  file(CREATE_LINK ${CMAKE_SOURCE_DIR}/scripts/tools/trocar_${tool}.py ${CMAKE_RUNTIME_OUTPUT_DIRECTORY}/trocar-${tool} SYMBOLIC)
  file(CREATE_LINK ../share/trocar/tools/trocar_${tool}.py ${CMAKE_BINARY_DIR}/tools/trocar-${tool} SYMBOLIC)
  install(FILES ${CMAKE_BINARY_DIR}/tools/trocar-${tool} DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT trocar-tools)
  install(PROGRAMS scripts/tools/trocar_${tool}.py DESTINATION ${share}/tools COMPONENT trocar-tools)
  trocar_man_page(trocar-${tool} trocar-tools ${CMAKE_SOURCE_DIR}/scripts/tools/trocar_${tool}.py ${CMAKE_SOURCE_DIR}/scripts/tools/trocar_command.py)
endforeach()
install(FILES scripts/tools/trocar_command.py scripts/tools/recording_datasets.json DESTINATION ${share}/tools COMPONENT trocar-tools)
# Many scans on a cluster (docs/farm.md).
install(DIRECTORY scripts/slurm scripts/snakemake DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/trocar-mesh/examples COMPONENT trocar-mesh
  USE_SOURCE_PERMISSIONS)

# --- examples -------------------------------------------------------------------------------------
# The sample's asset, the same vertebra filled inside and with a surface, and the scenes that need no other asset. Made by default only
# by the release build, because other builds take long for the surface.
set(examples ${CMAKE_BINARY_DIR}/examples)
foreach(scene one_slice three_slices network_middle network_rim vertebra vertebra_live)
  set(file ${CMAKE_SOURCE_DIR}/runtime/scenes/${scene}.json)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
  file(READ ${file} text)
  set(asset sample)
  if(scene MATCHES vertebra)
    set(asset vertebra)
  endif()
  string(REPLACE "../../out/sample.glb" "../${asset}.glb" text "${text}")
  file(CONFIGURE OUTPUT ${examples}/scenes/${scene}.json CONTENT "${text}" @ONLY)
endforeach()
set(scan ${CMAKE_BINARY_DIR}/examples-scan)
add_custom_command(OUTPUT ${examples}/sample.glb ${examples}/vertebra.glb
  COMMAND trocar-sample-ct ${scan} --quiet
  COMMAND trocar-mesh ${scan}/dicom -o ${examples}/sample.glb --quiet
  COMMAND trocar-mesh ${scan}/dicom --preset vertebra --surface -o ${examples}/vertebra.glb --quiet
  DEPENDS trocar-sample-ct trocar-mesh VERBATIM)
set(by_default)
if(CMAKE_BUILD_TYPE STREQUAL "Release" AND NOT TROCAR_SANITIZE)
  set(by_default ALL)
endif()
add_custom_target(trocar-examples ${by_default} DEPENDS ${examples}/sample.glb ${examples}/vertebra.glb)
install(DIRECTORY ${examples} DESTINATION ${share} COMPONENT trocar-examples)

# --- data ---------------------------------------------------------------------------------------
install(FILES formats/session/four_legs.json DESTINATION ${share}/device COMPONENT trocar-runtime)
install(FILES formats/session/scene.schema.json formats/session/device.schema.json formats/session/summary.schema.json
  formats/session/frames.schema.json formats/session/sheets.schema.json formats/session/session_report.schema.json
  formats/session/history.schema.json
  formats/session/device_test.schema.json formats/session/pose_device.schema.json
  DESTINATION ${share}/schemas COMPONENT trocar-runtime)
install(FILES formats/session/list.schema.json formats/session/preview.schema.json formats/session/info.schema.json
  formats/session/report.schema.json formats/session/collection.schema.json
  formats/session/review.schema.json
  DESTINATION ${share}/schemas COMPONENT trocar-mesh)
# The page; vendor/ is there once scripts/setup console has run, as scripts/package makes sure.
install(DIRECTORY runtime/console/page/ DESTINATION ${share}/console COMPONENT trocar-console
  FILES_MATCHING PATTERN *.html PATTERN *.js PATTERN *.css PATTERN LICENSE.* PATTERN node_modules EXCLUDE)
install(FILES scripts/debian/trocar-console.desktop DESTINATION ${CMAKE_INSTALL_DATADIR}/applications COMPONENT trocar-console)
# Realtime rights. Excluded from `cmake --install`, whose prefix says nothing about /etc; a package's prefix is /usr.
install(FILES scripts/debian/limits.conf RENAME trocar.conf DESTINATION ../etc/security/limits.d
  COMPONENT trocar-runtime EXCLUDE_FROM_ALL)
# The head CT of the tutorial, from Debian's invesalius-examples.
install(FILES scripts/lib/head_ct.py DESTINATION ${share} COMPONENT trocar-mesh)
install(PROGRAMS scripts/archive/orthanc-hook scripts/archive/get-study DESTINATION ${share} COMPONENT trocar-mesh)

# trocar_pages(COMPONENT FILES...): pages to read, beside those of every package. Links in them lead to the installed pages, which
# `pages_of` names for each package.
set(pages_of_trocar-mesh TUTORIAL.md trocar-mesh.md farm.md archive.md wrong-uses.md store.md)
set(pages_of_trocar-runtime trocar-run.md add-your-device.md device_link.md telemetry.md pose_drive.cpp)
set(pages_of_trocar-tools tools.md)
set(pages_of_trocar-console trocar-console.md openigtlink.md operating.md protocol.md)
function(trocar_pages component)
  foreach(page ${ARGN})
    get_filename_component(name ${page} NAME)
    if(name MATCHES "[.]md$")
      file(READ ${CMAKE_SOURCE_DIR}/${page} text)
      set_property(DIRECTORY ${CMAKE_SOURCE_DIR} APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${page})
      foreach(package trocar-mesh trocar-runtime trocar-tools trocar-console)
        foreach(other ${pages_of_${package}})
          string(REGEX REPLACE "\\]\\(([^()#: ]*/)?${other}([^)]*)\\)" "](/usr/share/doc/${package}/${other}\\2)" text "${text}")
        endforeach()
      endforeach()
      string(REGEX REPLACE "\\]\\(([^()#: ]*/)?glossary[.]md([^)]*)\\)" "](glossary.md\\2)" text "${text}")
      set(page ${CMAKE_BINARY_DIR}/pages/${component}/${name})
      file(WRITE ${page} "${text}")
    endif()
    install(FILES ${page} DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${component} COMPONENT ${component})
  endforeach()
endfunction()
trocar_pages(trocar-mesh TUTORIAL.md docs/trocar-mesh.md docs/farm.md docs/archive.md docs/wrong-uses.md docs/glossary.md pipeline/batch/store.md)
trocar_pages(trocar-runtime docs/trocar-run.md docs/glossary.md docs/add-your-device.md formats/examples/pose_drive.cpp
  formats/session/device_link.md formats/session/telemetry.md)
install(FILES scripts/debian/realtime.md RENAME README.Debian
  DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/trocar-runtime COMPONENT trocar-runtime)
trocar_pages(trocar-tools docs/tools.md docs/glossary.md)
trocar_pages(trocar-console docs/trocar-console.md docs/openigtlink.md docs/operating.md docs/glossary.md runtime/console/protocol.md)

# --- the library of formats -----------------------------------------------------------------------
target_compile_features(trocar_mesh_kernel PUBLIC cxx_std_20)
target_include_directories(trocar_mesh_kernel INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/trocar>)
set_target_properties(trocar_mesh_kernel PROPERTIES EXPORT_NAME mesh_kernel OUTPUT_NAME trocar-mesh-kernel)
set_target_properties(trocar_formats PROPERTIES EXPORT_NAME formats OUTPUT_NAME trocar-formats)
add_library(Trocar::formats ALIAS trocar_formats)
set(config ${CMAKE_INSTALL_LIBDIR}/cmake/Trocar)
install(TARGETS trocar_mesh_kernel trocar_formats EXPORT trocar_formats_targets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT trocar-formats-dev)
install(EXPORT trocar_formats_targets NAMESPACE Trocar:: FILE trocar-formats-targets.cmake
  DESTINATION ${config} COMPONENT trocar-formats-dev)
# Not the headers that include tinygltf, Draco, nlohmann/json, CLI11 or, as code that is in a library of its own, libsodium.
install(DIRECTORY formats/base formats/mesh formats/asset formats/session
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/trocar/formats COMPONENT trocar-formats-dev
  FILES_MATCHING PATTERN *.h PATTERN gltf*.h EXCLUDE PATTERN payload.h EXCLUDE PATTERN draco_settings.h EXCLUDE PATTERN scene_readers.h EXCLUDE
  PATTERN json.h EXCLUDE PATTERN command_line.h EXCLUDE PATTERN device_protocol.h EXCLUDE)
install(FILES formats/asset/asset.md
  DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/trocar-formats-dev COMPONENT trocar-formats-dev)
install(FILES formats/examples/CMakeLists.txt formats/examples/list_slices.cpp formats/examples/README.md
  DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/trocar-formats-dev/examples COMPONENT trocar-formats-dev)
configure_package_config_file(scripts/cmake/TrocarConfig.cmake.in ${CMAKE_BINARY_DIR}/TrocarConfig.cmake
  INSTALL_DESTINATION ${config})
write_basic_package_version_file(${CMAKE_BINARY_DIR}/TrocarConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/TrocarConfig.cmake ${CMAKE_BINARY_DIR}/TrocarConfigVersion.cmake
  DESTINATION ${config} COMPONENT trocar-formats-dev)

# --- Debian packages ----------------------------------------------------------------------------------
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_VENDOR "Trocar")
set(maintainer "The Trocar developers <trocar@example.org>")
if(DEFINED ENV{DEBFULLNAME} AND DEFINED ENV{DEBEMAIL})
  set(maintainer "$ENV{DEBFULLNAME} <$ENV{DEBEMAIL}>")
endif()
set(CPACK_PACKAGE_CONTACT "${maintainer}" CACHE STRING "Who maintains the packages: NAME <ADDRESS>")
set(TROCAR_HOMEPAGE "" CACHE STRING "The packages' address on the web; empty: none")
# Packages for different releases of Debian depend on different libraries, so their versions differ.
cmake_host_system_information(RESULT debian QUERY DISTRIB_VERSION_ID)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1~deb${debian})
set(release ${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})
set(packages trocar-mesh trocar-sample-ct trocar-runtime trocar-tools trocar-console trocar-examples trocar-formats-dev)
if(TROCAR_HOMEPAGE)
  set(CPACK_DEBIAN_PACKAGE_HOMEPAGE ${TROCAR_HOMEPAGE})
endif()

# Licences, README and changes, as Debian wants them. The changelog's date is that of the source.
execute_process(COMMAND git -C ${CMAKE_SOURCE_DIR} log -1 --format=%cD OUTPUT_VARIABLE date OUTPUT_STRIP_TRAILING_WHITESPACE
  ERROR_QUIET)
if(NOT date)
  string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
endif()
string(REGEX REPLACE ", ([0-9]) " ", 0\\1 " date "${date}")
file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/changelog.Debian @ONLY CONTENT
"trocar (@release@) unstable; urgency=medium

  * Version @PROJECT_VERSION@. Its changes are listed in changelog.gz.

 -- @CPACK_PACKAGE_CONTACT@ @date@
")
set(changes ${CMAKE_BINARY_DIR}/changelog.gz ${CMAKE_BINARY_DIR}/changelog.Debian.gz)
add_custom_command(OUTPUT ${changes}
  COMMAND gzip -9nc ${CMAKE_SOURCE_DIR}/CHANGELOG.md > ${CMAKE_BINARY_DIR}/changelog.gz
  COMMAND gzip -9nc ${CMAKE_BINARY_DIR}/changelog.Debian > ${CMAKE_BINARY_DIR}/changelog.Debian.gz
  DEPENDS CHANGELOG.md ${CMAKE_BINARY_DIR}/changelog.Debian VERBATIM)
add_custom_target(trocar-changelog ALL DEPENDS ${changes})
foreach(package ${packages})
  set(copyright scripts/debian/${package}.copyright)
  if(package MATCHES "examples|tools")
    set(copyright scripts/debian/own_work.copyright)
  endif()
  set(doc ${CMAKE_INSTALL_DATADIR}/doc/${package})
  install(FILES ${copyright} RENAME copyright DESTINATION ${doc} COMPONENT ${package})
  install(FILES README.md ${changes} DESTINATION ${doc} COMPONENT ${package})
endforeach()

set(CPACK_STRIP_FILES ON)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_COMPONENTS_ALL ${packages})
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
trocar_package(trocar-examples science "scenes of a puncture simulator with their meshes"
  "Scenes and assets of a phantom vertebra, for trocar-run and trocar-console.")
trocar_package(trocar-sample-ct science "sample CT scan of a lumbar vertebra"
  "trocar-sample-ct writes a phantom of a lumbar vertebra as PNG, DICOM and NIfTI.")
trocar_package(trocar-runtime science "haptic rendering of a needle or trocar going through bone"
  "trocar-run loads assets, renders the force of a puncture and drives a\nhaptic device; trocar-device-sim simulates the device.")
trocar_package(trocar-tools science "fits of tissues and HDF5 files for a puncture simulator"
  "trocar-fit makes a tissue from a measured curve of force over depth;\ntrocar-hdf5 converts recordings of sessions for Python, MATLAB and others.")
trocar_package(trocar-console science "operator's console of a puncture simulator"
  "trocar-console serves a page on this machine that starts, shows and commands\nsessions of trocar-run, and plays their recordings.")
trocar_package(trocar-formats-dev libdevel "library to read and write Trocar's mesh assets"
  "Headers, static library and CMake package Trocar, component formats.")
set(CPACK_DEBIAN_TROCAR-MESH_PACKAGE_SUGGESTS
  "dcmtk, orthanc, python3-nibabel, invesalius-examples, slurm-wlm, snakemake, trocar-runtime, trocar-sample-ct")
set(CPACK_DEBIAN_TROCAR-MESH_PACKAGE_BREAKS trocar-farm) # of version 0.2.0
set(CPACK_DEBIAN_TROCAR-RUNTIME_PACKAGE_DEPENDS "passwd")
set(CPACK_DEBIAN_TROCAR-RUNTIME_PACKAGE_SUGGESTS "trocar-mesh, trocar-console, trocar-tools")
set(CPACK_DEBIAN_TROCAR-TOOLS_PACKAGE_DEPENDS "python3, python3-numpy, python3-scipy, python3-h5py")
set(CPACK_DEBIAN_TROCAR-TOOLS_PACKAGE_RECOMMENDS "python3-matplotlib")
file(WRITE ${CMAKE_BINARY_DIR}/conffiles "/etc/security/limits.d/trocar.conf\n")
set(CPACK_DEBIAN_TROCAR-RUNTIME_PACKAGE_CONTROL_EXTRA
  ${CMAKE_BINARY_DIR}/conffiles ${CMAKE_SOURCE_DIR}/scripts/debian/postinst)
set(CPACK_DEBIAN_TROCAR-CONSOLE_PACKAGE_DEPENDS "trocar-runtime (= ${release}), trocar-examples (= ${release})")
set(CPACK_DEBIAN_TROCAR-CONSOLE_PACKAGE_SUGGESTS "chromium | firefox-esr")
set(CPACK_DEBIAN_TROCAR-FORMATS-DEV_PACKAGE_DEPENDS "libdraco-dev, libeigen3-dev, zlib1g-dev")
set(CPACK_DEBIAN_TROCAR-EXAMPLES_PACKAGE_SUGGESTS "trocar-console")
foreach(package FORMATS-DEV EXAMPLES TOOLS) # no programs in them
  set(CPACK_DEBIAN_TROCAR-${package}_PACKAGE_SHLIBDEPS OFF)
endforeach()
foreach(package EXAMPLES TOOLS)
  set(CPACK_DEBIAN_TROCAR-${package}_PACKAGE_ARCHITECTURE all)
endforeach()
include(CPack)
