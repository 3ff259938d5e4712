# SPDX-License-Identifier: Apache-2.0
# Functions and variables that declare tests, for all CMake lists below this folder.
find_package(GTest REQUIRED)
find_package(CGAL 5.5 REQUIRED)
set(TROCAR_PYTHON /usr/bin/python3 CACHE FILEPATH "Python with Debian's numpy, jsonschema, ...")
set(TROCAR_REAL_CT ${CMAKE_SOURCE_DIR}/../shared/ct CACHE PATH
  "Folder of real scans (l3/*.nii.gz); without it their tests are skipped")
set(TROCAR_PROGRAMS ${CMAKE_RUNTIME_OUTPUT_DIRECTORY})
set(TROCAR_E2E ${CMAKE_BINARY_DIR}/e2e)             # outputs of the end-to-end tests
set(TROCAR_TEST_ASSETS ${CMAKE_BINARY_DIR}/assets)  # made once (e2e/CMakeLists.txt)

# trocar_test(NAME LABEL LIBS...): NAME.cpp of this folder as a GoogleTest program, run as
# one ctest test with the label (unit, property, golden, fuzz or e2e).
function(trocar_test name label)
  add_executable(${name} ${name}.cpp)
  target_link_libraries(${name} PRIVATE ${ARGN} trocar_flags GTest::gtest GTest::gtest_main)
  target_compile_definitions(${name} PRIVATE TROCAR_CORPUS="${CMAKE_SOURCE_DIR}/tests/corpus")
  if(TROCAR_SANITIZE)
    target_compile_definitions(${name} PRIVATE TROCAR_SANITIZED)
  endif()
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES LABELS ${label} TIMEOUT 600)
endfunction()

# trocar_asset_test(NAME LABEL LIBS...): as trocar_test, with the assets of the scans in the folder of the
# environment variable TROCAR_ASSETS.
function(trocar_asset_test name label)
  trocar_test(${name} ${label} ${ARGN})
  set_tests_properties(${name} PROPERTIES FIXTURES_REQUIRED scan_assets
    ENVIRONMENT "TROCAR_ASSETS=${TROCAR_TEST_ASSETS}")
endfunction()

# trocar_script_test(NAME LABEL SCRIPT ARGUMENTS...): a Python test; exit code 77 means skipped.
function(trocar_script_test name label script)
  add_test(NAME ${name} COMMAND ${TROCAR_PYTHON} -B ${CMAKE_CURRENT_SOURCE_DIR}/${script} ${ARGN})
  set_tests_properties(${name} PROPERTIES LABELS ${label} TIMEOUT 600 SKIP_RETURN_CODE 77
    ENVIRONMENT "TROCAR_REAL_CT=${TROCAR_REAL_CT};TROCAR_SANITIZE=${TROCAR_SANITIZE}")
endfunction()

# trocar_wall_clock(NAMES...): labels tests of this folder that run in real time or compare times. A machine that stands
# still can make them fail, so .ci/run runs those that failed once more.
function(trocar_wall_clock)
  foreach(name ${ARGN})
    set_property(TEST ${name} APPEND PROPERTY LABELS wall_clock)
  endforeach()
endfunction()
