# SPDX-License-Identifier: Apache-2.0
# Functions and variables that declare tests, for all CMake lists below this folder.
find_package(GTest REQUIRED)
find_package(CGAL 5.5 REQUIRED)
set(TROCAR_PYTHON /usr/bin/python3 CACHE FILEPATH "Python with Debian's numpy, jsonschema, ...")
set(TROCAR_REAL_CT ${CMAKE_SOURCE_DIR}/../shared/ct CACHE PATH
  "Folder of real scans (l3/*.nii.gz); without it their tests are skipped")
set(TROCAR_PROGRAMS ${CMAKE_RUNTIME_OUTPUT_DIRECTORY})
set(TROCAR_E2E ${CMAKE_BINARY_DIR}/e2e) # outputs of the end-to-end tests
set(TROCAR_TEST_ASSETS ${CMAKE_BINARY_DIR}/assets) # made once (e2e/CMakeLists.txt)

# trocar_test(PATH LABEL LIBRARIES...): the GoogleTest file PATH.cpp as one ctest test, named after the file, with the label unit,
# property, golden, fuzz or e2e. All files of one CMake list are compiled into one program, FOLDER_tests, because linking a program
# for each file takes longer than compiling it; the program runs the tests of one file if it is named (support/test_main.cpp). Lists
# that are read while TROCAR_TEST_PROGRAM is set share the program of that name: in a unity build, the folders' files then share the
# time for the headers. Sets TROCAR_TESTS_OF_LIST to the program's name.
function(trocar_test path label)
  file(RELATIVE_PATH folder ${CMAKE_SOURCE_DIR}/tests ${CMAKE_CURRENT_SOURCE_DIR})
  string(REPLACE "/" "_" program ${folder}_tests)
  if(TROCAR_TEST_PROGRAM)
    set(program ${TROCAR_TEST_PROGRAM})
  endif()
  set(TROCAR_TESTS_OF_LIST ${program} PARENT_SCOPE)
  if(NOT TARGET ${program})
    add_executable(${program} ${CMAKE_SOURCE_DIR}/tests/support/test_main.cpp)
    target_link_libraries(${program} PRIVATE trocar_flags GTest::gtest)
    target_compile_definitions(${program} PRIVATE TROCAR_CORPUS="${CMAKE_SOURCE_DIR}/tests/corpus")
    if(TROCAR_SANITIZE)
      target_compile_definitions(${program} PRIVATE TROCAR_SANITIZED)
    endif()
  endif()
  target_sources(${program} PRIVATE ${path}.cpp)
  target_link_libraries(${program} PRIVATE ${ARGN})
  get_filename_component(name ${path} NAME)
  add_test(NAME ${name} COMMAND ${program} ${name}.cpp)
  set_tests_properties(${name} PROPERTIES LABELS ${label} TIMEOUT 600 PROCESSORS 2)
endfunction()

# trocar_asset_test(NAME LABEL LIBS...): as trocar_test, with the assets of the scans in the folder of the
# environment variable TROCAR_ASSETS.
function(trocar_asset_test path label)
  get_filename_component(name ${path} NAME)
  trocar_test(${path} ${label} ${ARGN})
  set_tests_properties(${name} PROPERTIES FIXTURES_REQUIRED scan_assets
    ENVIRONMENT "TROCAR_ASSETS=${TROCAR_TEST_ASSETS}")
endfunction()

# trocar_script_test(NAME LABEL SCRIPT OPTIONS...): a Python test, run by pytest with OPTIONS. Exit code 77 means that all its
# tests were skipped. support/programs.py reads the environment.
function(trocar_script_test name label script)
  add_test(NAME ${name} COMMAND ${TROCAR_PYTHON} -B -m pytest ${CMAKE_CURRENT_SOURCE_DIR}/${script} ${ARGN})
  trocar_script_properties(${name} ${label})
endfunction()

set(TROCAR_PYTHON_FOLDERS tests/support tests/e2e tests/formats/session tests/pipeline/read/dicom scripts/lib scripts/tools)
# trocar_plain_script_test(NAME LABEL SCRIPT ARGUMENTS...): a Python program as a test.
function(trocar_plain_script_test name label script)
  add_test(NAME ${name} COMMAND ${TROCAR_PYTHON} -B ${CMAKE_CURRENT_SOURCE_DIR}/${script} ${ARGN})
  trocar_script_properties(${name} ${label})
  # The folders of pytest.ini's pythonpath.
  list(TRANSFORM TROCAR_PYTHON_FOLDERS PREPEND ${CMAKE_SOURCE_DIR}/ OUTPUT_VARIABLE folders)
  list(JOIN folders ":" path)
  set_property(TEST ${name} APPEND PROPERTY ENVIRONMENT "PYTHONPATH=${path}")
endfunction()

function(trocar_script_properties name label)
  set_tests_properties(${name} PROPERTIES LABELS ${label} TIMEOUT 600 PROCESSORS 2 SKIP_RETURN_CODE 77 ENVIRONMENT
    "TROCAR_REAL_CT=${TROCAR_REAL_CT};TROCAR_SANITIZE=${TROCAR_SANITIZE};TROCAR_BUILD=${CMAKE_BINARY_DIR};TROCAR_WORK=${TROCAR_E2E}/${name}")
endfunction()

# PROCESSORS counts half cores, and scripts/test gives ctest two of them for each core: most tests use a core.
# trocar_waits(NAMES...): tests of this folder that mostly wait, for a session in real time or for another program, and use at most
# half a core.
function(trocar_waits)
  set_tests_properties(${ARGN} PROPERTIES PROCESSORS 1)
endfunction()

# trocar_long(NAMES...): labels tests of this folder that take more than half a minute, which scripts/test leaves to
# scripts/test --all and so to CI. They begin first.
function(trocar_long)
  foreach(name ${ARGN})
    set_property(TEST ${name} APPEND PROPERTY LABELS long)
    set_tests_properties(${name} PROPERTIES COST 100)
  endforeach()
endfunction()

# trocar_wall_clock(NAMES...): labels tests of this folder that run in real time or compare times. A machine that stands
# still can make them fail, so .ci/run runs those that failed once more.
function(trocar_wall_clock)
  foreach(name ${ARGN})
    set_property(TEST ${name} APPEND PROPERTY LABELS wall_clock)
  endforeach()
endfunction()
