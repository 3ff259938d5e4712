# SPDX-License-Identifier: Apache-2.0
# Tests that are not C++: rules about the tree, and the programs as a user runs them.
set(TROCAR_PYTHON /usr/bin/python3 CACHE FILEPATH "Python with Debian's numpy, jsonschema, ...")
set(TROCAR_REAL_CT ${CMAKE_SOURCE_DIR}/../shared/ct CACHE PATH
  "Folder of real scans (l3/*.nii.gz); their tests are skipped where it is absent")

function(trocar_script_test name label script)
  add_test(NAME ${name} COMMAND ${TROCAR_PYTHON} -B ${CMAKE_CURRENT_SOURCE_DIR}/${script} ${ARGN})
  set_tests_properties(${name} PROPERTIES LABELS ${label} TIMEOUT 600 SKIP_RETURN_CODE 77
    ENVIRONMENT "TROCAR_REAL_CT=${TROCAR_REAL_CT};TROCAR_SANITIZE=${TROCAR_SANITIZE}")
endfunction()

set(programs ${CMAKE_RUNTIME_OUTPUT_DIRECTORY})
trocar_script_test(schema_test unit schema_test.py ${CMAKE_SOURCE_DIR})
trocar_script_test(head_ct_test unit head_ct_test.py ${CMAKE_SOURCE_DIR})
if(CMAKE_GENERATOR MATCHES Ninja)
  trocar_script_test(dependency_rule_test unit dependency_rule_test.py
    ${CMAKE_SOURCE_DIR} ${CMAKE_BINARY_DIR} ${programs}/trocar-run)
endif()
set(e2e ${CMAKE_BINARY_DIR}/e2e)
add_test(NAME e2e_scan COMMAND ${programs}/trocar-sample-ct ${e2e}/scan --quiet)
set_tests_properties(e2e_scan PROPERTIES LABELS e2e TIMEOUT 600 FIXTURES_SETUP scan)
trocar_script_test(nifti_orientation_test e2e nifti_orientation_test.py
  ${programs} ${e2e}/orientation)
trocar_script_test(mesh_program_e2e e2e mesh_program_e2e_test.py
  ${programs} ${e2e}/scan ${e2e}/mesh_program)
trocar_script_test(dicom_variants_test e2e dicom_variants_test.py
  ${programs} ${CMAKE_BINARY_DIR}/e2e/dicom_variants)
foreach(case sample l3 head)
  trocar_script_test(assets_e2e_${case} e2e assets_e2e_test.py
    ${case} ${CMAKE_SOURCE_DIR} ${programs} ${e2e}/scan ${e2e}/${case})
endforeach()
trocar_script_test(experiments_e2e e2e experiments_e2e_test.py
  ${CMAKE_SOURCE_DIR} ${programs} ${e2e}/scan ${e2e}/experiments)
if(NOT TROCAR_SANITIZE)  # these measure or limit memory, of which sanitizers take far more
  trocar_script_test(program_mutants_test fuzz program_mutants_test.py
    ${programs} ${CMAKE_SOURCE_DIR}/tests/corpus ${CMAKE_BINARY_DIR}/e2e/program_mutants 200)
  trocar_script_test(memory_growth_test e2e memory_growth_test.py
    ${programs} ${e2e}/scan ${e2e}/memory_growth)
  set_tests_properties(memory_growth_test PROPERTIES FIXTURES_REQUIRED scan)
endif()
trocar_script_test(same_bytes_test e2e same_bytes_test.py
  ${programs} ${e2e}/scan ${e2e}/same_bytes)
trocar_script_test(device_link_e2e e2e device_link_e2e_test.py
  ${CMAKE_SOURCE_DIR} ${programs} ${e2e}/scan ${e2e}/device_link)
trocar_script_test(recovery_e2e e2e recovery_e2e_test.py
  ${CMAKE_SOURCE_DIR} ${programs} ${e2e}/scan ${e2e}/recovery)
trocar_script_test(fault_campaign e2e fault_campaign_test.py
  ${CMAKE_SOURCE_DIR} ${programs} ${e2e}/scan ${e2e}/fault_campaign --times 2)
set_tests_properties(assets_e2e_sample experiments_e2e same_bytes_test mesh_program_e2e
  device_link_e2e recovery_e2e fault_campaign
  PROPERTIES FIXTURES_REQUIRED scan)
# It measures two processes in real time: what runs beside it, slow under sanitizers, would stall them.
set_tests_properties(fault_campaign PROPERTIES RUN_SERIAL ON)
