# SPDX-License-Identifier: Apache-2.0
# Finds Debian's libopencv-{core,imgproc,imgcodecs}-dev without the full libopencv-dev,
# the only package with OpenCVConfig.cmake. Defines OpenCV::core, OpenCV::imgproc and
# OpenCV::imgcodecs, with their headers as system headers.
set(_parts core imgproc imgcodecs)
find_path(OpenCVParts_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4)
foreach(_part ${_parts})
  find_library(OpenCVParts_${_part} opencv_${_part})
  list(APPEND _needed OpenCVParts_${_part})
endforeach()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenCVParts REQUIRED_VARS OpenCVParts_INCLUDE_DIR ${_needed})
foreach(_part ${_parts})
  add_library(OpenCV::${_part} UNKNOWN IMPORTED GLOBAL)
  set_target_properties(OpenCV::${_part} PROPERTIES
    IMPORTED_LOCATION "${OpenCVParts_${_part}}"
    INTERFACE_INCLUDE_DIRECTORIES "${OpenCVParts_INCLUDE_DIR}"
    INTERFACE_SYSTEM_INCLUDE_DIRECTORIES "${OpenCVParts_INCLUDE_DIR}")
endforeach()
set_property(TARGET OpenCV::imgproc PROPERTY INTERFACE_LINK_LIBRARIES OpenCV::core)
set_property(TARGET OpenCV::imgcodecs PROPERTY INTERFACE_LINK_LIBRARIES "OpenCV::imgproc;OpenCV::core")
