// SPDX-License-Identifier: Apache-2.0
// OpenIGTLink messages with headers of version 1, which every client reads. Lengths are in mm, as the
// protocol wants it.
// Tests: tests/e2e/console_igtl_test.py
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <string>

namespace trocar::runtime {

/// Code of a STATUS message: a part of those that OpenIGTLink defines.
enum class IgtlStatus : std::uint8_t {
  kOk = 1,
  kUnknownError = 2,
  kEmergency = 3,
  kTimeOut = 7,
  kNotReady = 13,
  kNotPresent = 16,
  kShutDown = 19,
};
enum class IgtlUnit : std::uint8_t { kSecond, kNewton };

/// Name and time of a message. A name has at most 19 characters.
struct IgtlStamp {
  const char* name;
  double unix_s;  ///< UTC, since 1970
};

/// TRANSFORM: the pose of the object's frame; its translation is in mm.
std::string transform_message(IgtlStamp stamp, const Eigen::Affine3d& T_mm);
/// SENSOR: at most 255 values of one unit.
std::string sensor_message(IgtlStamp stamp, std::span<const double> values, IgtlUnit unit);
/// STATUS: `error` has at most 19 characters.
std::string status_message(IgtlStamp stamp, IgtlStatus code, const std::string& error,
                           const std::string& text);
/// POLYDATA: x, y, z of each vertex in mm, and the numbers of three vertices for each triangle.
std::string polydata_message(IgtlStamp stamp, std::span<const float> vertices_mm,
                             std::span<const std::uint32_t> triangles);

}  // namespace trocar::runtime
