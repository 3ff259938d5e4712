// SPDX-License-Identifier: Apache-2.0
#include "runtime/hdf5/recording_hdf5.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <span>
#include <type_traits>
#include <utility>

#include "formats/session/recording.h"
#include "runtime/hdf5/hdf5_file.h"

namespace trocar::runtime {
namespace {

constexpr const char* kSchema = "trocar.recording-hdf5/1";
constexpr const char* kFrames =
    "device: the frame {B} of the haptic device's base, z up. pose device: the own frame of a "
    "device that measures its own pose.";
constexpr const char* kDeviceFrame = "device";
constexpr const char* kOwnFrame = "pose device";
constexpr const char* kNoFrame = "";

using Row = RecordingRow;

/// A dataset: columns of the recording that belong together.
struct Dataset {
  const char* name;
  const char* first;  ///< the first of the recording's columns
  const char* unit;
  const char* frame;  ///< empty: the quantity does not depend on a frame
  const char* meaning;
  std::size_t width, element_bytes;
  Hdf5Type type;
  std::vector<std::string> enumerators;
  void (*copy)(const Row& row, std::byte* out);
};

template <typename T>
constexpr Hdf5Type type_of() {
  if constexpr (std::is_same_v<T, double>) return Hdf5Type::kFloat64;
  if constexpr (std::is_same_v<T, std::int32_t>) return Hdf5Type::kInt32;
  if constexpr (std::is_same_v<T, std::int64_t>) return Hdf5Type::kInt64;
  if constexpr (std::is_same_v<T, std::uint32_t>) return Hdf5Type::kUint32;
  return Hdf5Type::kUint8;
}
/// The numbers of a field: one, or those of an array.
template <typename T>
struct Numbers {
  using type = T;
  static constexpr std::size_t kCount = 1;
};
template <typename T, std::size_t N>
struct Numbers<std::array<T, N>> {
  using type = T;
  static constexpr std::size_t kCount = N;
};

/// Follows a path of members, such as &Row::cutting, &Row::Cutting::tip_N.
template <auto... Members>
const auto& field_of(const Row& row) {
  // clang-format off
  return (row .* ... .* Members);
  // clang-format on
}

/// `Members` leads to a number, an enumerator or an array of numbers.
template <auto... Members>
Dataset make(const char* name, const char* first, const char* unit, const char* frame,
             const char* meaning) {
  using Value = std::remove_cvref_t<decltype(field_of<Members...>(std::declval<const Row&>()))>;
  using Element = typename Numbers<Value>::type;
  return {name,
          first,
          unit,
          frame,
          meaning,
          Numbers<Value>::kCount,
          sizeof(Element),
          type_of<Element>(),
          {},
          [](const Row& row, std::byte* out) {
            std::memcpy(out, &field_of<Members...>(row), sizeof(Value));
          }};
}

/// A dataset with the name of its only column.
template <auto... Members>
Dataset make(const char* name, const char* unit, const char* frame, const char* meaning) {
  return make<Members...>(name, name, unit, frame, meaning);
}

/// An enumeration with `count` enumerators.
template <auto Member>
Dataset choice(const char* name, const char* meaning, int count) {
  using Enum = std::remove_cvref_t<decltype(field_of<Member>(std::declval<const Row&>()))>;
  static_assert(sizeof(Enum) == 1);
  Dataset made = make<Member>(name, "1", kNoFrame, meaning);
  for (int i = 0; i < count; ++i)
    made.enumerators.emplace_back(to_string(static_cast<Enum>(i)));
  return made;
}

/// All datasets that a recording may have, in the order of its columns.
std::vector<Dataset> all_datasets() {
  constexpr int kPhases = static_cast<int>(ContactPhase::kFault) + 1;
  return {
      make<&Row::t_s>("t_s", "s", kNoFrame, "time in the session"),
      make<&Row::p_m>("p_m", "x_m", "m", kDeviceFrame, "origin of the plate"),
      make<&Row::q>("q", "qw", "1", kDeviceFrame,
                    "orientation of the plate: quaternion w, x, y, z"),
      make<&Row::tool_m>("tool_m", "tool_x_m", "m", kDeviceFrame, "tip of the tool"),
      make<&Row::wrench_wanted>("wrench_wanted", "fx_wanted_N", "wrench", kDeviceFrame,
                                "wanted force and torque on the plate, at its origin"),
      make<&Row::wrench_delivered>("wrench_delivered", "fx_delivered_N", "wrench", kDeviceFrame,
                                   "force and torque that the device renders"),
      make<&Row::pose_device, &Row::PoseDevice::p_m>(
          "device_p_m", "device_x_m", "m", kOwnFrame,
          "the point of the handle on which the wrench acts"),
      make<&Row::pose_device, &Row::PoseDevice::q>(
          "device_q", "device_qw", "1", kOwnFrame,
          "orientation of the handle: quaternion w, x, y, z"),
      make<&Row::pose_device, &Row::PoseDevice::buttons>("buttons", "1", kNoFrame,
                                                         "bit i is set while button i is pressed"),
      make<&Row::pose_device, &Row::PoseDevice::wrench>("device_wrench", "fx_device_N", "wrench",
                                                        kOwnFrame, "commanded force and torque"),
      make<&Row::tau_Nm>("tau_Nm", "tau_1_1_Nm", "N m", kNoFrame,
                         "torques of the motors, leg by leg"),
      make<&Row::encoder_rad>("motor_angle_rad", "th_1_1_rad", "rad", kNoFrame,
                              "angles of all encoders, leg by leg"),
      choice<&Row::phase>("state", "state of the contact", kPhases),
      make<&Row::active_slice>("active_slice", "1", kNoFrame,
                               "index of the active slice in the asset; -1: none"),
      make<&Row::penetration_m>("penetration_m", "m", kNoFrame, "penetration of the active slice"),
      make<&Row::wrench_scale>("wrench_scale", "1", kNoFrame, "rendered over wanted wrench"),
      make<&Row::pose_residual_m>("pose_residual_m", "m", kNoFrame,
                                  "residual of the pose fitted to the encoders"),
      make<&Row::cuts_published>("cuts_published", "1", kNoFrame,
                                 "number of holes whose new mesh is in use"),
      make<&Row::response_sheet>(
          "response_sheet", "1", kNoFrame,
          "sheet of the prefetched stiffness, from the topmost, 0; -1: none"),
      make<&Row::response_stiffness_N_per_m>("response_stiffness_N_per_m", "N/m", kNoFrame,
                                             "prefetched stiffness"),
      make<&Row::response_offset_m>("response_offset_m", "response_x_m", "m", kDeviceFrame,
                                    "point of the force relative to the tool's centre: x, y"),
      choice<&Row::fault>("fault", "reason why the loop is in its safe state", kFaults),
      choice<&Row::device_read>("device_read", "result of reading the device",
                                kRecordedDeviceStatuses),
      make<&Row::state_t_s>("state_t_s", "s", kNoFrame,
                            "time of the measurement, on the device's clock"),
      choice<&Row::device_write>("device_write", "result of writing to the device",
                                 kRecordedDeviceStatuses),
      choice<&Row::outside_fault>("outside_fault", "fault that was found outside of the tick",
                                  kFaults),
      make<&Row::recovery_asked>("recovery_asked", "1", kNoFrame,
                                 "1: the operator requested recovery in this tick"),
      choice<&Row::safety>("safety", "state of the safety layer", kSafetyStates),
      make<&Row::authority>("authority", "1", kNoFrame,
                            "factor on the wanted wrench after a recovery"),
      make<&Row::passivity_J>("passivity_J", "J", kNoFrame, "energy of the passivity observer"),
      make<&Row::passivity_N_s_per_m>("passivity_N_s_per_m", "N s/m", kNoFrame,
                                      "damping of the passivity controller"),
      make<&Row::motor_heat_max>("motor_heat_max", "1", kNoFrame,
                                 "largest thermal state of a motor; 1 is its limit"),
      make<&Row::xray>("xray", "1", kNoFrame,
                       "X-ray in the tick: 1 a picture, 2 screening, 3 both; 0: none"),
      make<&Row::cutting, &Row::Cutting::wrench_tissue>(
          "wrench_tissue", "fx_tissue_N", "wrench", kDeviceFrame,
          "force and torque of the tissue on the plate, before the force scale"),
      make<&Row::cutting, &Row::Cutting::front_z_m>(
          "front_z_m", "m", kDeviceFrame,
          "height of the cutting front, or of the next bone below the tip"),
      make<&Row::cutting, &Row::Cutting::front_HU>(
          "front_HU", "HU", kNoFrame, "mean HU under the tool in the slice of the cutting front"),
      make<&Row::tip_N>("tip_N", "N", kNoFrame,
                        "force of the tissue on the tip, before the force scale"),
      make<&Row::cutting, &Row::Cutting::embedded_m>("embedded_m", "m", kNoFrame,
                                                     "length of the shaft inside the bone volume"),
      make<&Row::cutting, &Row::Cutting::cut_J>(
          "cut_J", "J", kNoFrame, "work of the cutting front since the session began"),
      make<&Row::cutting, &Row::Cutting::absorbed_J>(
          "absorbed_J", "J", kNoFrame, "work of the hand on the tissue since the session began"),
      make<&Row::cutting, &Row::Cutting::stored_J>("stored_J", "tissue_stored_J", "J", kNoFrame,
                                                   "elastic energy stored in the tissue"),
      make<&Row::cutting, &Row::Cutting::steps>("steps", "1", kNoFrame, "number of Newton steps"),
      make<&Row::break_through_N>("break_through_N", "N", kNoFrame,
                                  "resistance that a break-through in this tick has lost; 0: none"),
      make<&Row::break_through_at>(
          "break_through_at", "1", kNoFrame,
          "slice of the break-through; -2, -3, ...: soft layer 1, 2, ...; -1: none"),
  };
}

std::vector<std::string> names_in(std::string_view header) {
  std::vector<std::string> names;
  while (true) {
    const std::size_t comma = header.find(',');
    names.emplace_back(header.substr(0, comma));
    if (comma == std::string_view::npos) return names;
    header.remove_prefix(comma + 1);
  }
}

Hdf5Table table_of(const Dataset& dataset, const std::vector<Row>& rows) {
  const std::size_t bytes = dataset.width * dataset.element_bytes;
  Hdf5Table table{dataset.name, dataset.type, dataset.width, dataset.enumerators,
                  std::vector<std::byte>(rows.size() * bytes)};
  for (std::size_t i = 0; i < rows.size(); ++i)
    dataset.copy(rows[i], table.data.data() + i * bytes);
  return table;
}

/// The unit of each column. A wrench has three forces and three torques.
std::vector<std::string> units_of(const Dataset& dataset) {
  if (std::string_view(dataset.unit) == "wrench") return {"N", "N", "N", "N m", "N m", "N m"};
  return std::vector<std::string>(dataset.width, dataset.unit);
}

}  // namespace

Result<RecordingHdf5> recording_hdf5(std::string_view csv, const std::string& name) {
  RecordingOrigin origin;
  const Result<std::vector<Row>> rows = parse_recording(csv, name, &origin);
  if (!rows) return rows.error();
  const std::vector<std::string> columns = names_in(csv.substr(0, csv.find('\n')));
  Hdf5File file;
  file.set_attribute("/", "schema", kSchema);
  file.set_attribute("/", "written_by", "trocar-export " TROCAR_VERSION);
  file.set_attribute("/", "frames", kFrames);
  for (const auto& [key, value] : origin.entries)
    file.set_attribute("/", "origin." + key, value);
  RecordingHdf5 made;
  std::size_t next = 0;  // the first column that has no dataset yet
  for (const Dataset& dataset : all_datasets()) {
    if (next == columns.size() || columns[next] != dataset.first) continue;
    file.add(table_of(dataset, *rows));
    file.set_attribute(dataset.name, "meaning", dataset.meaning);
    file.set_attribute(dataset.name, "units", units_of(dataset));
    if (*dataset.frame != '\0') file.set_attribute(dataset.name, "frame", dataset.frame);
    file.set_attribute(dataset.name, "columns", std::span(columns).subspan(next, dataset.width));
    next += dataset.width;
    ++made.datasets;
  }
  if (next < columns.size() && columns[next] != "origin")
    return bug("the column " + columns[next] + " has no dataset");
  Result<std::vector<std::uint8_t>> bytes = file.bytes();
  if (!bytes) return bytes.error();
  made.bytes = std::move(*bytes);
  made.ticks = rows->size();
  return made;
}

}  // namespace trocar::runtime
