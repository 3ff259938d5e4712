# SPDX-License-Identifier: Apache-2.0
# Finds Debian's libopencv-{core,imgproc,imgcodecs}-dev without the full libopencv-dev,
# the only package with OpenCVConfig.cmake. Defines OpenCV::core, OpenCV::imgproc and
# OpenCV::imgcodecs, with their headers as system headers, and OpenCVParts_VERSION.
find_path(OpenCVParts_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4)
find_library(OpenCVParts_core_LIBRARY opencv_core)
find_library(OpenCVParts_imgproc_LIBRARY opencv_imgproc)
find_library(OpenCVParts_imgcodecs_LIBRARY opencv_imgcodecs)
mark_as_advanced(OpenCVParts_INCLUDE_DIR OpenCVParts_core_LIBRARY
  OpenCVParts_imgproc_LIBRARY OpenCVParts_imgcodecs_LIBRARY)

if(OpenCVParts_INCLUDE_DIR AND EXISTS "${OpenCVParts_INCLUDE_DIR}/opencv2/core/version.hpp")
  set(OpenCVParts_VERSION "")
  foreach(_part MAJOR MINOR REVISION)
    file(STRINGS "${OpenCVParts_INCLUDE_DIR}/opencv2/core/version.hpp" _line
      REGEX "^#define CV_VERSION_${_part}[ \t]+[0-9]+")
    string(REGEX MATCH "[0-9]+$" _number "${_line}")
    list(APPEND OpenCVParts_VERSION ${_number})
  endforeach()
  list(JOIN OpenCVParts_VERSION "." OpenCVParts_VERSION)
endif()

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenCVParts
  REQUIRED_VARS OpenCVParts_INCLUDE_DIR OpenCVParts_core_LIBRARY
    OpenCVParts_imgproc_LIBRARY OpenCVParts_imgcodecs_LIBRARY
  VERSION_VAR OpenCVParts_VERSION)

if(OpenCVParts_FOUND)
  foreach(_part core imgproc imgcodecs)
    if(NOT TARGET OpenCV::${_part})
      add_library(OpenCV::${_part} UNKNOWN IMPORTED GLOBAL)
      set_target_properties(OpenCV::${_part} PROPERTIES
        IMPORTED_LOCATION "${OpenCVParts_${_part}_LIBRARY}"
        INTERFACE_INCLUDE_DIRECTORIES "${OpenCVParts_INCLUDE_DIR}"
        INTERFACE_SYSTEM_INCLUDE_DIRECTORIES "${OpenCVParts_INCLUDE_DIR}")
    endif()
  endforeach()
  set_property(TARGET OpenCV::imgproc PROPERTY INTERFACE_LINK_LIBRARIES OpenCV::core)
  set_property(TARGET OpenCV::imgcodecs PROPERTY INTERFACE_LINK_LIBRARIES "OpenCV::imgproc;OpenCV::core")
endif()
