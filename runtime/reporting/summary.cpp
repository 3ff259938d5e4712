// SPDX-License-Identifier: Apache-2.0
#include "runtime/reporting/summary.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/session/trainee.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

json quantiles(const Histogram& histogram) {
  return {{"p50", histogram.quantile_us(0.5)},
          {"p99", histogram.quantile_us(0.99)},
          {"p999", histogram.quantile_us(0.999)},
          {"max", histogram.max_us()},
          {"samples", histogram.samples()}};
}

json buckets(const Histogram& histogram) {
  json list = json::array();
  histogram.each_quarter_octave([&](double upper_us, std::uint64_t count) {
    list.push_back({upper_us, count});
  });
  return list;
}

json describe(const LateTicks::Counts& late_ticks) {
  json counts;
  for (std::size_t part = 0; part < kTickParts; ++part)
    counts[kTickPartNames.at(part)] = late_ticks.at(part);
  return counts;
}

json describe(const RealtimeReport& realtime) {
  return {{"scheduling", realtime.scheduling},
          {"realtime_priority", realtime.fifo},
          {"memory_locked", realtime.memory_locked},
          {"cpus", realtime.cpus},
          {"kernel_is_realtime", realtime.kernel_is_realtime},
          {"timer_slack_ns", realtime.timer_slack_ns},
          {"note", realtime.note}};
}

json time_or_null(double t_s) {
  return t_s < 0 ? json(nullptr) : json(t_s);
}

/// Returns the number, or null if the quantity of the fault has no number.
json number_or_null(const FaultDetail& detail, double number) {
  const bool has_number =
      detail.quantity != FaultQuantity::kNone && detail.quantity != FaultQuantity::kMotor;
  return has_number ? json(number) : json(nullptr);
}

/// Returns the message of a file's error. If the file's name is absolute, its folder is left out.
std::string without_folder_of(const std::filesystem::path& file, std::string message) {
  if (!file.is_absolute()) return message;
  for (const std::string& folder : {file.parent_path().string() + "/", file.parent_path().string()})
    for (std::size_t at = 0; (at = message.find(folder, at)) != std::string::npos;)
      message.erase(at, folder.size());
  return message;
}

json describe_faults(const SessionResult& report) {
  json list = json::array();
  for (const FaultEvent& event : report.faults) {
    json fault = {{"fault", to_string(event.fault)},
                  {"t_s", event.t_s},
                  {"torques_zero_t_s", time_or_null(event.torques_zero_t_s)},
                  {"recovered_t_s", time_or_null(event.recovered_t_s)},
                  {"quantity", nullptr},
                  {"value", number_or_null(event.detail, event.detail.value)},
                  {"limit", number_or_null(event.detail, event.detail.limit)},
                  {"message", trocar::describe(event.detail, event.t_s)},
                  {"black_box", nullptr}};
    if (const std::string quantity = quantity_name(event.detail); !quantity.empty())
      fault["quantity"] = quantity;
    const auto box =  // there is no black box if the request was lost
        std::find_if(report.black_boxes.begin(), report.black_boxes.end(),
                     [&event](const BlackBoxFile& b) { return b.t_s == event.t_s; });
    if (box != report.black_boxes.end()) {
      fault["black_box"] = without_folder(box->file);
      fault["black_box_rows"] = box->rows;
      if (box->error) fault["black_box_error"] = without_folder_of(box->file, box->error->message);
    }
    list.push_back(std::move(fault));
  }
  return list;
}

const CutRecord* find_record(const Remesher& remesher, const PunctureEvent& event) {
  const auto found = std::find_if(
      remesher.records().begin(), remesher.records().end(), [&](const CutRecord& record) {
        return record.request.sheet == event.sheet && record.request.cut == event.cut;
      });
  return found == remesher.records().end() ? nullptr : &*found;
}

json describe(const PunctureEvent& event, const Remesher& remesher) {
  json puncture = {{"slice", event.slice},
                   {"t_s", event.t_s},
                   {"tool_z_m", event.tool_z_m},
                   {"tip_N", event.tip_N},
                   {"hand_N", event.hand_N},
                   {"trial_force_N", event.trial_force_N},
                   {"penetration_m", event.penetration_m},
                   {"slice_z_m", remesher.first_version(event.sheet).z_m},
                   {"remesh_us", nullptr},
                   {"hole_vertices", nullptr}};
  const CutRecord* record = find_record(remesher, event);
  if (record == nullptr) return puncture;
  if (record->error) {
    puncture["error"] = record->error->message;
    return puncture;
  }
  puncture["remesh_us"] = record->remesh_us;
  puncture["hole_vertices"] = record->hole_vertices;
  puncture["triangles_removed"] = record->cut.triangles_removed;
  puncture["triangles_created"] = record->cut.triangles_created;
  return puncture;
}

json points(const std::vector<LatticePoint>& list) {
  json result = json::array();
  for (const LatticePoint p : list)
    result.push_back({p.x, p.y});
  return result;
}

json describe(const SliceMesh& mesh) {
  return {{"vertices", points(mesh.vertices)}, {"triangles", mesh.triangles}};
}

}  // namespace

std::string summarize(const Scene& scene, const SessionOptions& options,
                      const SessionResult& report, const Remesher& remesher,
                      const std::string& link_json) {
  json summary = {
      {"schema", "trocar.summary/1"},
      {"program", "trocar-run " TROCAR_VERSION},
      {"scene", scene.name},
      {"trainee", nullptr},
      {"clock", options.is_real_time() ? "real" : "virtual"},
      {"rate_Hz", options.rate_Hz},
      {"end", to_string(report.end)},
      {"ticks", report.ticks},
      {"missed_deadlines", report.realtime.missed_deadlines},
      {"tick_us", quantiles(report.tick)},
      {"device_us", quantiles(report.device)},
      {"wake_us", quantiles(report.realtime.wake)},
      {"allocations_in_loop", nullptr},
      {"page_faults_in_loop", report.realtime.page_faults},
      {"missed_deadlines_by", describe(report.late_ticks)},
      {"missed_deadlines_in_row_max", report.realtime.missed_in_row_max},
      {"realtime", describe(report.realtime)},
      {"tick_histogram_us", buckets(report.tick)},
      {"wake_histogram_us", buckets(report.realtime.wake)},
      {"xray",
       {{"shots", report.xray.shots}, {"screening_s", report.xray.screening_s(options.rate_Hz)}}},
      {"max_force_N", report.max_force_N},
      {"punctures", json::array()},
      {"punctures_not_listed", report.punctures_not_listed},
      {"faults", describe_faults(report)},
      {"faults_count", report.faults_count},
      {"passivity",
       {{"on", options.passivity.on && !report.law->is_passive()},
        {"damped_ticks", report.damped_ticks},
        {"damping_max_N_s_per_m", report.damping_max_N_s_per_m},
        {"energy_released_max_J", report.energy_released_max_J}}},
      {"wrench_error_max", report.wrench_error_max},
      {"scaled_ticks", report.scaled_ticks},
      {"torque_max_Nm", report.torque_max_Nm},
  };
  if (const Result<Trainee> trainee = stated_trainee(options.origin); trainee)
    summary["trainee"] = parse_known_json(to_json(*trainee));
  if (report.allocations_in_loop) summary["allocations_in_loop"] = *report.allocations_in_loop;
  if (const SummarySection law = report.law->summary(); !law.key.empty())
    summary[law.key] = parse_known_json(law.json);
  for (const PunctureEvent& event : report.punctures) {
    summary["punctures"].push_back(describe(event, remesher));
  }
  if (!options.replay.empty()) {
    const bool differs = report.replay_first_difference >= 0;
    summary["replay"] = {{"rows", options.replay.size()},
                         {"identical_torques", !differs},
                         {"first_difference_row", nullptr}};
    if (differs) summary["replay"]["first_difference_row"] = report.replay_first_difference + 1;
  }
  if (!link_json.empty()) summary["link"] = parse_known_json(link_json);
  return json_text(summary, 2);
}

std::string describe_sheets(const Scene& scene, const Remesher& remesher) {
  json sheets = json::array();
  for (std::size_t i = 0; i < remesher.size(); ++i) {
    const Sheet& first = remesher.first_version(i);
    json sheet = {{"slice", first.slice_index},
                  {"z_m", first.z_m},
                  {"at_m", {first.transform.at_m.x(), first.transform.at_m.y()}},
                  {"anchor_mm", {first.transform.anchor_mm.x(), first.transform.anchor_mm.y()}},
                  {"rotation_deg", scene.placement.rotation_deg},
                  {"before", describe(to_slice_mesh(first.mesh))},
                  {"after", describe(to_slice_mesh(remesher.last_version(i).mesh))},
                  {"cuts", json::array()}};
    for (const CutRecord& record : remesher.records()) {
      if (record.request.sheet != static_cast<std::int32_t>(i) || record.error) continue;
      json hole = json::array();
      for (const Ring& ring : remesher.hole(record))
        hole.push_back(points(ring));
      sheet["cuts"].push_back({{"tool", points(to_ring(record.request.outline))},
                               {"hole", hole},
                               {"triangles_removed", record.cut.triangles_removed},
                               {"triangles_created", record.cut.triangles_created},
                               {"doubled_area_removed", record.cut.doubled_area_removed}});
    }
    sheets.push_back(std::move(sheet));
  }
  const int bits = remesher.size() > 0 ? remesher.first_version(0).transform.lattice.bits : 0;
  return json_text(
      {{"schema", "trocar.sheets/1"}, {"lattice_bits", bits}, {"sheets", std::move(sheets)}});
}

}  // namespace trocar::runtime
