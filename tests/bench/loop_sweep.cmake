# SPDX-License-Identifier: Apache-2.0
# The measuring program behind the section "Loop" of scripts/report.
add_executable(loop_sweep bench/loop_sweep.cpp)
target_link_libraries(loop_sweep PRIVATE trocar_loop trocar_flags)
trocar_script_test(loop_sweep_test e2e bench/loop_sweep_test.py $<TARGET_FILE:loop_sweep>)
