# SPDX-License-Identifier: Apache-2.0
# The three scans' assets for C++ tests, made once by the program as a user would: assets/sample.glb
# always, l3.glb and head.glb where their scans are.
set(TROCAR_TEST_ASSETS ${CMAKE_BINARY_DIR}/assets)
trocar_script_test(scan_assets e2e make_assets.py ${programs} ${e2e}/scan ${TROCAR_TEST_ASSETS})
set_tests_properties(scan_assets PROPERTIES FIXTURES_SETUP scan_assets FIXTURES_REQUIRED scan)

# trocar_asset_test(NAME LABEL LIBS...): as trocar_test; finds the assets in the folder TROCAR_ASSETS.
function(trocar_asset_test name label)
  trocar_test(${name} ${label} ${ARGN})
  set_tests_properties(${name} PROPERTIES FIXTURES_REQUIRED scan_assets
    ENVIRONMENT "TROCAR_ASSETS=${TROCAR_TEST_ASSETS}")
endfunction()
