// SPDX-License-Identifier: Apache-2.0
// A stress case of the device (tests/corpus/device): one input of kinematics, allocation, motors,
// limits, description, packets or the whole loop, and the correct result. Format:
// tests/corpus/README.md.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "runtime/device/device.h"
#include "runtime/device/four_legs/kinematics.h"
#include "tests/cases/stress_case.h"

namespace trocar::test {

/// A number, or the name of one that JSON cannot write.
inline std::optional<double> number_or_name(const nlohmann::json& value) {
  if (value.is_number()) return value.get<double>();
  static const std::map<std::string, double> kNames = {
      {"nan", std::numeric_limits<double>::quiet_NaN()},
      {"inf", std::numeric_limits<double>::infinity()},
      {"-inf", -std::numeric_limits<double>::infinity()},
      {"smallest", std::numeric_limits<double>::denorm_min()},
      {"-smallest", -std::numeric_limits<double>::denorm_min()},
      {"smallest normal", std::numeric_limits<double>::min()},
      {"largest", std::numeric_limits<double>::max()},
      {"-0", -0.0}};
  const auto name = value.is_string() ? kNames.find(value.get<std::string>()) : kNames.end();
  if (name == kNames.end()) return std::nullopt;
  return name->second;
}

/// Reads the fields of one object. Missing fields and wrong types are added to `errors`; finish()
/// adds fields that were not read.
class DeviceFields {
 public:
  DeviceFields(const nlohmann::json& value, std::string path, JsonErrors& errors)
      : object_(value, path, errors), path_(std::move(path)), errors_(errors) {}

  bool has(const char* key) const { return object_.has(key); }
  double number(const char* key, double otherwise) {
    const nlohmann::json* found = object_.optional_value(key);
    return found == nullptr ? otherwise : read(*found, key);
  }
  /// An array of `size` numbers; a single number stands for all of them.
  std::vector<double> numbers(const char* key, std::size_t size, double otherwise) {
    const nlohmann::json* found = object_.optional_value(key);
    std::vector<double> out(size, otherwise);
    if (found == nullptr) return out;
    if (!found->is_array()) return std::vector<double>(size, read(*found, key));
    if (found->size() != size) {
      errors_.add(path_ + "/" + key, "must be " + std::to_string(size) + " numbers");
      return out;
    }
    for (std::size_t i = 0; i < size; ++i)
      out[i] = read((*found)[i], key);
    return out;
  }
  std::string text(const char* key, const std::string& otherwise) {
    return object_.has(key) ? object_.string(key) : otherwise;
  }
  const nlohmann::json& object(const char* key) {
    static const nlohmann::json kEmpty = nlohmann::json::object();
    const nlohmann::json* found = object_.optional_value(key);
    return found == nullptr ? kEmpty : *found;
  }
  void finish() { object_.finish(); }

 private:
  double read(const nlohmann::json& value, const char* key) {
    const std::optional<double> x = number_or_name(value);
    if (!x) errors_.add(path_ + "/" + key, "must be a number or the name of one");
    return x.value_or(0);
  }
  StrictObject object_;
  std::string path_;
  JsonErrors& errors_;
};

/// {p_m, turn_deg: rotation vector} or {p_m, q: w x y z, not normalized}; with `towards` the pose
/// is moved in this direction to the end of the device's reach, and back from there by inside_m.
inline runtime::Pose read_pose(const DeviceDescription& device, const nlohmann::json& value,
                               JsonErrors& errors) {
  DeviceFields o(value, "/pose", errors);
  const auto p = o.numbers("p_m", 3, 0), turn = o.numbers("turn_deg", 3, 0),
             q = o.numbers("q", 4, 0), towards = o.numbers("towards", 3, 0);
  const double inside_m = o.number("inside_m", 0);
  runtime::Pose out;
  out.p_m << p[0], p[1], p[2];
  if (o.has("q")) {
    out.q = Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
  } else {
    out.q = runtime::from_rotation_vector(Eigen::Vector3d(turn[0], turn[1], turn[2]) *
                                          (std::acos(-1.0) / 180));
  }
  if (o.has("towards")) {
    const Eigen::Vector3d direction =
        Eigen::Vector3d(towards[0], towards[1], towards[2]).normalized();
    const auto moved = [&](double distance_m) {
      return runtime::Pose{out.p_m + distance_m * direction, out.q};
    };
    double inside = 0, outside = 0.5;
    for (int i = 0; i < 80; ++i) {
      const double middle = (inside + outside) / 2;
      (runtime::inverse_kinematics(device, moved(middle)).status ? inside : outside) = middle;
    }
    out = moved(inside - inside_m);
  }
  o.finish();
  return out;
}

}  // namespace trocar::test
