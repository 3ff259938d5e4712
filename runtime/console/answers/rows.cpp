// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/answers/rows.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <span>
#include <vector>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/base/text_line.h"
#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "formats/session/xray_use.h"
#include "runtime/console/answers/container.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxBytes = std::uint64_t{2} << 30;
constexpr std::size_t kMaxRows = 200'000;
constexpr int kContactPhases = static_cast<int>(ContactPhase::kFault) + 1;

struct Column {
  const char* name;
  int count;
  enum class Of : std::uint8_t {
    kAll,
    kCutting,
    kXray
  } of = Of::kAll;  ///< recordings that have it
};
// The columns, in the order of append().
constexpr std::array kColumns{Column{"t_s", 1},
                              Column{"p_m", 3},
                              Column{"q", 4},
                              Column{"tool_m", 3},
                              Column{"wrench_wanted", 6},
                              Column{"wrench_delivered", 6},
                              Column{"tau_Nm", 8},
                              Column{"motor_angle_rad", 16},
                              Column{"phase", 1},
                              Column{"active_slice", 1},
                              Column{"penetration_m", 1},
                              Column{"wrench_scale", 1},
                              Column{"pose_residual_m", 1},
                              Column{"cuts_published", 1},
                              Column{"fault", 1},
                              Column{"safety", 1},
                              Column{"authority", 1},
                              Column{"passivity_J", 1},
                              Column{"motor_heat_max", 1},
                              Column{"xray_shots", 1, Column::Of::kXray},
                              Column{"xray_screening_s", 1, Column::Of::kXray},
                              Column{"front_z_m", 1, Column::Of::kCutting},
                              Column{"front_HU", 1, Column::Of::kCutting},
                              Column{"tip_N", 1, Column::Of::kCutting},
                              Column{"embedded_m", 1, Column::Of::kCutting},
                              Column{"cut_J", 1, Column::Of::kCutting},
                              Column{"absorbed_J", 1, Column::Of::kCutting},
                              Column{"stored_J", 1, Column::Of::kCutting}};

void append(std::vector<double>& out, const RecordingRow& row, const RecordingKind& kind,
            const XrayUse& xray, double rate_Hz) {
  const auto all = [&out](std::span<const double> numbers) {
    out.insert(out.end(), numbers.begin(), numbers.end());
  };
  out.push_back(row.t_s);
  all(row.p_m);
  all(row.q);
  all(row.tool_m);
  all(row.wrench_wanted);
  all(row.wrench_delivered);
  all(row.tau_Nm);
  all(row.encoder_rad);
  for (const double x :
       {static_cast<double>(row.phase), static_cast<double>(row.active_slice), row.penetration_m,
        row.wrench_scale, row.pose_residual_m, static_cast<double>(row.cuts_published),
        static_cast<double>(row.fault), static_cast<double>(row.safety), row.authority,
        row.passivity_J, row.motor_heat_max})
    out.push_back(x);
  if (kind.has_xray) {
    out.push_back(static_cast<double>(xray.shots));
    out.push_back(xray.screening_s(rate_Hz));
  }
  if (!kind.has_cutting) return;
  const RecordingRow::Cutting& c = row.cutting;
  for (const double x :
       {c.front_z_m, c.front_HU, c.tip_N, c.embedded_m, c.cut_J, c.absorbed_J, c.stored_J})
    out.push_back(x);
}

/// Returns punctures, faults and recoveries. Punctures cannot be found in rows of the force law
/// `cutting`, because the tool is also in holes on its way out.
json events_of(const std::vector<RecordingRow>& rows, bool with_punctures) {
  constexpr std::size_t kMaxEventsOfAnswer = 20'000;
  json events = json::array();
  RecordingRow before;
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
    if (is_new_fault(before.safety, before.fault, row)) {
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
  const auto rows = parse_recording({reinterpret_cast<const char*>(bytes->data()), bytes->size()},
                                    recording.filename().string(), &origin);
  if (!rows) return rows.error();
  const RecordingKind kind = recording_kind(origin);
  const double rate_Hz = origin.number("rate_Hz").value_or(0);
  if (kind.has_xray && !(rate_Hz > 0))
    return refused(recording.filename().string() + ": has X-ray, but not the rate of its ticks");
  const std::size_t every = std::max<std::size_t>(1, (rows->size() + kMaxRows - 1) / kMaxRows);
  json columns = json::array();
  std::size_t width = 0;
  for (const Column& column : kColumns) {
    if (column.of == Column::Of::kCutting && !kind.has_cutting) continue;
    if (column.of == Column::Of::kXray && !kind.has_xray) continue;
    columns.push_back({{"name", column.name}, {"count", column.count}});
    width += static_cast<std::size_t>(column.count);
  }
  std::vector<double> table;
  table.reserve((rows->size() / every + 2) * width);
  XrayUse xray;
  for (std::size_t i = 0; i < rows->size(); ++i) {
    xray.add((*rows)[i]);
    if (i % every == 0 || i + 1 == rows->size()) append(table, (*rows)[i], kind, xray, rate_Hz);
  }
  const std::optional<double> scale = origin.number("force-scale");
  Arrays arrays;
  const auto at = arrays.add(table);
  return arrays.with_json(json_text({{"schema", "trocar.rows/1"},
                                     {"columns", columns},
                                     {"rows", table.size() / width},
                                     {"every", every},
                                     {"rows_at", at},
                                     {"phases", names_of<ContactPhase>(kContactPhases)},
                                     {"faults", names_of<Fault>(kFaults)},
                                     {"safety_states", names_of<SafetyState>(kSafetyStates)},
                                     {"force_scale", scale ? json(*scale) : json(nullptr)},
                                     {"events", events_of(*rows, !kind.has_cutting)}}));
}

}  // namespace trocar::runtime
