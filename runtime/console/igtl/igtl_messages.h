// SPDX-License-Identifier: Apache-2.0
// Packs OpenIGTLink messages. Their headers have the protocol's version 1, which every client can
// read. Lengths are in mm, as the protocol requires. Each function returns a whole message.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <string>

namespace trocar::runtime {

/// The codes of STATUS messages that the console sends. OpenIGTLink defines more codes.
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

/// Packs a TRANSFORM: the pose of an object, as a transform with the translation in mm.
std::string transform_message(IgtlStamp stamp, const Eigen::Affine3d& T_mm);
/// Packs a SENSOR message: at most 255 values of one unit.
std::string sensor_message(IgtlStamp stamp, std::span<const double> values, IgtlUnit unit);
/// Packs a STATUS message: a code, the name of an error, and a text. `error` has at most 19
/// characters, and is empty if there is no error.
std::string status_message(IgtlStamp stamp, IgtlStatus code, const std::string& error,
                           const std::string& text);
/// Packs a POLYDATA message: x, y, z of each vertex in mm, and three vertex
/// indices for each triangle.
std::string polydata_message(IgtlStamp stamp, std::span<const float> vertices_mm,
                             std::span<const std::uint32_t> triangles);

}  // namespace trocar::runtime
