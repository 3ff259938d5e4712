# SPDX-License-Identifier: Apache-2.0
# The measuring program behind scripts/report; ctest runs it once on little, and checks what it says,
# and what the report makes of it.
add_executable(pipeline_sweep bench/pipeline_sweep.cpp bench/sweep_scan.cpp bench/outline_error.cpp
  bench/peers.cpp)
target_link_libraries(pipeline_sweep PRIVATE trocar_pipeline trocar_sample_ct trocar_flags
  OpenCV::imgproc OpenCV::imgcodecs)
trocar_script_test(pipeline_sweep_test e2e bench/pipeline_sweep_test.py $<TARGET_FILE:pipeline_sweep>)
trocar_script_test(report_test unit bench/report_test.py ${CMAKE_SOURCE_DIR})
