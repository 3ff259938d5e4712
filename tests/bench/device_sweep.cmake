# SPDX-License-Identifier: Apache-2.0
# The measuring program behind the report's section on the device; ctest runs it once on little.
add_executable(device_sweep bench/device_sweep.cpp bench/kinematics_rows.cpp)
target_link_libraries(device_sweep PRIVATE trocar_device trocar_flags)
trocar_script_test(device_sweep_test e2e bench/device_sweep_test.py $<TARGET_FILE:device_sweep>)
