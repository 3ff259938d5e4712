# SPDX-License-Identifier: Apache-2.0
# The measuring program behind the section "Scene loading" of scripts/report; ctest holds its bytes
# to their bounds.
add_executable(scene_sweep bench/scene_sweep.cpp bench/heap_meter.cpp)
target_link_libraries(scene_sweep PRIVATE trocar_loop trocar_flags)
if(NOT TROCAR_SANITIZE)  # the heap meter stands where theirs does
  trocar_script_test(scene_sweep_test e2e bench/scene_sweep_test.py $<TARGET_FILE:scene_sweep>
    ${CMAKE_SOURCE_DIR}/scripts/lib/report ${CMAKE_SOURCE_DIR}/scripts/plots)
  set_tests_properties(scene_sweep_test PROPERTIES FIXTURES_REQUIRED scan_assets
    ENVIRONMENT "TROCAR_ASSETS=${TROCAR_TEST_ASSETS}")
endif()
