# SPDX-License-Identifier: Apache-2.0
# The measuring program behind the section "Conditioning" of scripts/report; ctest holds it to its
# stated bounds on few inputs.
add_executable(conditioning_sweep bench/conditioning_sweep.cpp bench/conditioning_predicates.cpp
  bench/conditioning_network.cpp bench/conditioning_device.cpp bench/conditioning_allocation.cpp)
target_link_libraries(conditioning_sweep PRIVATE trocar_loop trocar_flags)
trocar_script_test(conditioning_sweep_test property bench/conditioning_sweep_test.py
  $<TARGET_FILE:conditioning_sweep> ${CMAKE_SOURCE_DIR}/scripts/lib/report ${CMAKE_SOURCE_DIR}/scripts/plots)
