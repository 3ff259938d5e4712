// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/answers/rows.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>
#include <vector>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/base/text_line.h"
#include "formats/session/fault_words.h"
#include "formats/session/held_stops.h"
#include "formats/session/recording.h"
#include "formats/session/xray_use.h"
#include "runtime/console/answers/container.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxBytes = std::uint64_t{2} << 30;
constexpr std::size_t kMaxRows = 200'000;
constexpr int kContactPhases = static_cast<int>(ContactPhase::kFault) + 1;

/// Calls visit(name, values) for each column of a recording of this kind.
template <typename Visit>
void visit_columns(const RecordingRow& row, const RecordingKind& kind, const XrayUse& xray,
                   double rate_Hz, const Visit& visit) {
  const auto one = [&visit](const char* name, auto value) {
    const auto number = static_cast<double>(value);
    visit(name, std::span<const double>(&number, 1));
  };
  one("t_s", row.t_s);
  visit("p_m", row.p_m);
  visit("q", row.q);
  visit("tool_m", row.tool_m);
  visit("wrench_wanted", row.wrench_wanted);
  visit("wrench_delivered", row.wrench_delivered);
  if (!kind.has_pose_device) {
    visit("tau_Nm", row.tau_Nm);
    visit("motor_angle_rad", row.encoder_rad);
  }
  one("phase", row.phase);
  one("active_slice", row.active_slice);
  one("penetration_m", row.penetration_m);
  one("wrench_scale", row.wrench_scale);
  one("pose_residual_m", row.pose_residual_m);
  one("cuts_published", row.cuts_published);
  one("fault", row.fault);
  one("safety", row.safety);
  one("authority", row.authority);
  one("passivity_J", row.passivity_J);
  one("motor_heat_max", row.motor_heat_max);
  one("tip_N", row.tip_N);
  if (kind.has_xray) {
    one("xray_shots", xray.shots);
    one("xray_screening_s", xray.screening_s(rate_Hz));
  }
  if (!kind.has_cutting) return;
  one("front_z_m", row.cutting.front_z_m);
  one("front_HU", row.cutting.front_HU);
  one("embedded_m", row.cutting.embedded_m);
  one("cut_J", row.cutting.cut_J);
  one("absorbed_J", row.cutting.absorbed_J);
  one("stored_J", row.cutting.stored_J);
}

/// Returns punctures, break-throughs, faults and recoveries. Punctures cannot be found in rows of the force law
/// `cutting`, because the tool is also in holes on its way out.
json events_of(const std::vector<RecordingRow>& rows, bool with_punctures) {
  constexpr std::size_t kMaxEventsOfAnswer = 20'000;
  json events = json::array();
  RecordingRow before;
  FaultStarts faults;
  const auto add_xray = [&events](const char* kind, const char* what, double t_s) {
    events.push_back(
        {{"kind", kind}, {"t_s", t_s}, {"text", text_line("%s at %.3f s", what, t_s)}});
  };
  for (const RecordingRow& row : rows) {
    if (events.size() >= kMaxEventsOfAnswer) break;  // one row can add several
    const bool is_punctured =
        with_punctures && row.phase == ContactPhase::kPunctured &&
        (before.phase != ContactPhase::kPunctured || before.active_slice != row.active_slice);
    if (is_punctured) {
      events.push_back({{"kind", "puncture"},
                        {"t_s", row.t_s},
                        {"slice", row.active_slice},
                        {"tool_z_m", row.tool_m[2]},
                        {"penetration_m", row.penetration_m},
                        {"text", text_line("slice %d punctured at %.3f s: depth %.2f mm",
                                           row.active_slice, row.t_s, row.penetration_m * 1e3)}});
    }
    if (row.break_through_N > 0) {
      events.push_back(
          {{"kind", "break_through"},
           {"t_s", row.t_s},
           {"at", row.break_through_at},
           {"tool_z_m", row.tool_m[2]},
           {"tip_N", row.break_through_N},
           {"text", describe_break_through(row.break_through_at, row.t_s, row.break_through_N)}});
    }
    if (faults.take(row)) {
      const FaultWords& words = words_of(row.fault);
      events.push_back({{"kind", "fault"},
                        {"t_s", row.t_s},
                        {"fault", words.name},
                        {"meaning", words.meaning},
                        {"advice", words.advice},
                        {"text", describe(FaultDetail(row.fault), row.t_s)}});
    }
    if (row.fault != before.fault && row.fault == Fault::kNone) {
      events.push_back(
          {{"kind", "recovered"},
           {"t_s", row.t_s},
           {"fault", to_string(before.fault)},
           {"text", text_line("recovered from %s at %.3f s", to_string(before.fault), row.t_s)}});
    }
    if ((row.xray & kXrayPicture) != 0) add_xray("xray_shot", "X-ray shot", row.t_s);
    if (const int is_on = row.xray & kXrayBeam; is_on != (before.xray & kXrayBeam)) {
      add_xray(is_on != 0 ? "xray_on" : "xray_off",
               is_on != 0 ? "X-ray screening began" : "X-ray screening ended", row.t_s);
    }
    before = row;
  }
  return events;
}

}  // namespace

Result<std::string> rows_of(const std::filesystem::path& recording) {
  const auto bytes = read_file(recording, kMaxBytes);
  if (!bytes) return bytes.error();
  RecordingOrigin origin;
  bool is_cut = false;
  const auto rows = parse_recording({reinterpret_cast<const char*>(bytes->data()), bytes->size()},
                                    recording.filename().string(), &origin, &is_cut);
  if (!rows) return rows.error();
  const RecordingKind kind = recording_kind(origin);
  const double rate_Hz = origin.number("rate_Hz").value_or(0);
  if (kind.has_xray && !(rate_Hz > 0))
    return refused(recording.filename().string() + ": has X-ray, but not the rate of its ticks");
  const std::size_t every = std::max<std::size_t>(1, (rows->size() + kMaxRows - 1) / kMaxRows);
  XrayUse xray;
  json columns = json::array();
  std::size_t width = 0;
  visit_columns({}, kind, xray, rate_Hz, [&](const char* name, std::span<const double> values) {
    columns.push_back({{"name", name}, {"count", values.size()}});
    width += values.size();
  });
  std::vector<double> table;
  table.reserve((rows->size() / every + 2) * width);
  const auto append = [&table](const char*, std::span<const double> values) {
    table.insert(table.end(), values.begin(), values.end());
  };
  for (std::size_t i = 0; i < rows->size(); ++i) {
    const RecordingRow& row = (*rows)[i];
    xray.add(row);
    if (i % every == 0 || i + 1 == rows->size()) visit_columns(row, kind, xray, rate_Hz, append);
  }
  Arrays arrays;
  const auto at = arrays.add(table);
  return arrays.with_json(json_text({{"schema", "trocar.rows/1"},
                                     {"is_cut", is_cut},
                                     {"columns", columns},
                                     {"rows", table.size() / width},
                                     {"every", every},
                                     {"rows_at", at},
                                     {"phases", names_of<ContactPhase>(kContactPhases)},
                                     {"faults", names_of<Fault>(kFaults)},
                                     {"safety_states", names_of<SafetyState>(kSafetyStates)},
                                     {"events", events_of(*rows, !kind.has_cutting)}}));
}

}  // namespace trocar::runtime
