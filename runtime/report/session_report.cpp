// SPDX-License-Identifier: Apache-2.0
#include "runtime/report/session_report.h"

#include <nlohmann/json.hpp>

#include "embedded/runtime/report/session_page.js.h"
#include "formats/base/html_page.h"
#include "formats/base/json.h"
#include "formats/base/text.h"

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

json or_null(const std::optional<double>& value) {
  return value ? json(*value) : json(nullptr);
}

json describe(const Scene& scene, const ReportFacts& facts, const std::optional<Punctured>& what) {
  json out = {{"layer", nullptr}, {"slice", nullptr}};
  if (what && what->is_layer) out["layer"] = scene.layers[what->index].name;
  if (what && !what->is_layer) out["slice"] = facts.sheets[what->index].slice;
  return out;
}

const char* name_of(PlungeEnd end) {
  constexpr std::array<const char*, 4> kNames = {"time", "reversed", "fault", "end"};
  return kNames[static_cast<std::size_t>(end)];
}

json describe(const Tremor& tremor) {
  std::optional<double> rms_m;
  if (tremor.ticks > 0) rms_m = std::sqrt(tremor.squares_m2 / static_cast<double>(tremor.ticks));
  return {{"ticks", tremor.ticks}, {"across_rms_m", or_null(rms_m)}};
}

json describe_goals(const Scene& scene, const SessionFigures& f) {
  json out = {{"line", nullptr}, {"target", nullptr}, {"zones", json::array()}};
  if (!scene.goals) return out;
  if (scene.goals->line) {
    out["line"] = {
        {"ticks", f.line_ticks}, {"max_m", nullptr}, {"rms_m", nullptr}, {"entry_m", nullptr}};
    if (f.line_ticks > 0) {
      out["line"]["max_m"] = f.line_max_m;
      out["line"]["rms_m"] = std::sqrt(f.line_squares_m2 / static_cast<double>(f.line_ticks));
      out["line"]["entry_m"] = f.line_entry_m;
    }
  }
  if (scene.goals->target) {
    out["target"] = {{"closest_m", or_null(f.target_m)},
                     {"closest_t_s", f.target_m ? json(f.target_t_s) : json(nullptr)},
                     {"reached_t_s", or_null(f.target_reached_s)}};
  }
  for (std::size_t i = 0; i < f.zones.size(); ++i) {
    const ZoneFigures& zone = f.zones[i];
    json breaches = json::array();
    for (const Span& span : zone.breaches.list)
      breaches.push_back({{"from_s", span.from_s},
                          {"to_s", span.to_s},
                          {"depth_m", span.depth_m},
                          {"depth_t_s", span.depth_t_s}});
    out["zones"].push_back({{"name", scene.goals->zones[i].name},
                            {"min_m", or_null(zone.min_m)},
                            {"min_t_s", zone.min_m ? json(zone.min_t_s) : json(nullptr)},
                            {"breaches", std::move(breaches)},
                            {"breaches_count", zone.breaches.count}});
  }
  return out;
}

json describe_samples(const SessionFigures& f) {
  json rows = json::array();
  for (const ReportSample& s : f.samples)
    rows.push_back({s.t_s, s.tip_m[0], s.tip_m[1], s.tip_m[2], s.hand_N, or_null(s.front_HU)});
  return {{"stride", f.stride},
          {"columns", {"t_s", "tool_x_m", "tool_y_m", "tool_z_m", "hand_N", "front_HU"}},
          {"rows", std::move(rows)}};
}

/// Returns the line about a fault, with the measured value if it is known.
std::string fault_message(const ReportFault& fault, const ReportFacts& facts) {
  for (const FaultEvent& event : facts.result.faults) {
    if (event.fault == fault.fault && event.t_s == fault.t_s)
      return trocar::describe(event.detail, event.t_s);
  }
  return trocar::describe(FaultDetail(fault.fault), fault.t_s);
}

json describe_sheets(const ReportFacts& facts) {
  json out = json::array();
  for (const ReportSheet& sheet : facts.sheets)
    out.push_back({{"slice", sheet.slice},
                   {"z_m", sheet.z_m},
                   {"tissue", sheet.tissue.empty() ? json(nullptr) : json(sheet.tissue)}});
  return out;
}

json describe_path(const SessionFigures& f) {
  const bool has_path = f.counted > 0;
  json out = {{"length_m", f.length_m},
              {"insertion_m", or_null(f.insertion_m)},
              {"straight_m", or_null(f.straight_m)},
              {"straightness", nullptr},
              {"lowest_z_m", has_path ? json(f.lowest_z_m) : json(nullptr)},
              {"depth_max_m", has_path ? json(f.top_z_m - f.lowest_z_m) : json(nullptr)}};
  if (f.insertion_m && *f.insertion_m > 0) out["straightness"] = *f.straight_m / *f.insertion_m;
  return out;
}

double seconds(std::uint64_t ticks, const SessionFigures& f) {
  return static_cast<double>(ticks) / f.rate_Hz;
}

json describe_time(const SessionFigures& f) {
  json out = {{"total_s", seconds(f.ticks, f)},
              {"free_s", seconds(f.free, f)},
              {"contact_s", seconds(f.contact, f)},
              {"through_s", seconds(f.through, f)},
              {"stopped_s", seconds(f.ticks - f.counted, f)},
              {"first_contact_s", or_null(f.first_contact_s)},
              {"last_puncture_s", or_null(f.last_puncture_s)},
              {"contact_to_last_puncture_s", nullptr}};
  if (f.first_contact_s && f.last_puncture_s)
    out["contact_to_last_puncture_s"] = *f.last_puncture_s - *f.first_contact_s;
  return out;
}

json describe_force(const SessionFigures& f) {
  json out = {{"max_N", f.force_max_N},
              {"max_t_s", f.force_max_t_s},
              {"max_tip_m", f.force_max_tip_m},
              {"time_integral_N_s", f.counted_sum_N / f.rate_Hz},
              {"contact_mean_N", nullptr}};
  if (f.contact > 0) out["contact_mean_N"] = f.contact_sum_N / static_cast<double>(f.contact);
  return out;
}

json describe_attempts(const SessionFigures& f) {
  json listed = json::array();
  for (const Span& span : f.attempts.list)
    listed.push_back({{"from_s", span.from_s}, {"to_s", span.to_s}});
  return {{"count", f.attempts.count},
          {"reentries", f.attempts.count > 0 ? f.attempts.count - 1 : 0},
          {"leave_m", kLeave_m},
          {"listed", std::move(listed)}};
}

/// Returns how far the tool is outside bone at its final position; null if it is not in bone.
json describe_final_wall(const SessionFigures& f, const ReportFacts& facts) {
  if (!facts.final_wall) return nullptr;
  const WallViolation& wall = *facts.final_wall;
  return {{"t_s", f.lowest_t_s},
          {"tip_m", f.lowest_m},
          {"outside_m", wall.outside_m},
          {"grade", grade_of(wall.outside_m)},
          {"grade_is", words_of_grade(grade_of(wall.outside_m))},
          {"slice", wall.slice < 0 ? json(nullptr) : json(wall.slice)},
          {"first_slice", wall.first_slice},
          {"slices_judged", wall.slices_judged}};
}

json describe_punctures(const Scene& scene, const SessionFigures& f, const ReportFacts& facts) {
  json out = json::array();
  for (const ReportPuncture& p : f.punctures.list) {
    json made = describe(scene, facts, p.what);
    made.update({{"t_s", p.t_s},
                 {"hand_N", p.hand_N},
                 {"tip_N", p.tip_N},
                 {"depth_m", p.depth_m},
                 {"tip_z_m", p.tip_z_m},
                 {"front_HU", or_null(p.front_HU)}});
    out.push_back(std::move(made));
  }
  return out;
}

json describe_break_throughs(const Scene& scene, const SessionFigures& f,
                             const ReportFacts& facts) {
  json out = json::array();
  for (const BreakThrough& b : f.break_throughs.list) {
    json made = describe(scene, facts, b.what);
    made.update({{"t_s", b.t_s},
                 {"tip_N", b.tip_N},
                 {"plunge_m", b.plunge_m},
                 {"hand_m", b.hand_m},
                 {"release_m", b.plunge_m - b.hand_m},
                 {"below_m", or_null(b.below_m)},
                 {"lowest_t_s", b.lowest_t_s},
                 {"ended_t_s", b.ended_t_s},
                 {"ended_by", name_of(b.ended_by)}});
    out.push_back(std::move(made));
  }
  return out;
}

json describe_walls(const SessionFigures& f) {
  json misses = json::array(), side_cuts = json::array();
  for (const Span& span : f.misses.list)
    misses.push_back({{"slice", span.slice < 0 ? json(nullptr) : json(span.slice)},
                      {"from_s", span.from_s},
                      {"to_s", span.to_s}});
  for (const Span& span : f.side_cuts.list)
    side_cuts.push_back({{"slice", span.slice}, {"t_s", span.from_s}});
  return {{"beside", std::move(misses)},
          {"beside_count", f.misses.count},
          {"beside_s", seconds(f.missed_ticks, f)},
          {"side_cuts", std::move(side_cuts)},
          {"side_cuts_count", f.side_cuts.count}};
}

json describe_faults(const SessionFigures& f, const ReportFacts& facts) {
  json out = json::array();
  for (const ReportFault& fault : f.faults.list)
    out.push_back({{"fault", words_of(fault.fault).name},
                   {"t_s", fault.t_s},
                   {"recovered_t_s", or_null(fault.recovered_s)},
                   {"message", fault_message(fault, facts)}});
  return out;
}

json describe_results(const SessionFigures& f) {
  json out = json::array();
  for (const GoalResult& goal : f.goals)
    out.push_back({{"goal", goal.goal},
                   {"zone", goal.zone.empty() ? json(nullptr) : json(goal.zone)},
                   {"limit", goal.limit},
                   {"limit_is", goal.at_least ? "least" : "largest"},
                   {"value", or_null(goal.value)},
                   {"unit", goal.unit},
                   {"attempted", goal.attempted},
                   {"met", goal.met},
                   {"how", goal.how}});
  return out;
}

/// Returns the data that the pictures of the page need in addition to the report.
json describe_drawing(const Scene& scene, const SessionFigures& f, const ReportFacts& facts) {
  json layers = json::array(), goals = nullptr;
  for (const SceneLayer& layer : scene.layers)
    layers.push_back(
        {{"name", layer.name}, {"top_z_m", layer.top_z_m}, {"thickness_m", layer.thickness_m}});
  if (scene.goals) {
    goals = {{"force_max_N", or_null(scene.goals->force_max_N)},
             {"line", nullptr},
             {"target", nullptr},
             {"zones", json::array()}};
    if (const auto& line = scene.goals->line)
      goals["line"] = {{"entry_m", line->entry_m},
                       {"direction", line->direction},
                       {"entry_radius_m", or_null(line->entry_radius_m)}};
    if (const auto& target = scene.goals->target)
      goals["target"] = {{"at_m", target->at_m}, {"radius_m", target->radius_m}};
    constexpr std::array<const char*, 3> kShapes = {"capsule", "box", "prism"};
    for (const ForbiddenZone& zone : scene.goals->zones)
      goals["zones"].push_back({{"name", zone.name},
                                {"shape", kShapes[static_cast<std::size_t>(zone.shape)]},
                                {"low_m", zone.low_m},
                                {"high_m", zone.high_m},
                                {"radius_m", zone.radius_m},
                                {"outline_m", zone.outline_m},
                                {"z_m", zone.z_m}});
  }
  return {{"top_z_m", f.top_z_m},
          {"lowest_m", f.lowest_m},
          {"plunge", {{"limit_s", kPlunge_s}}},
          {"layers", std::move(layers)},
          {"material_m", facts.material_m},
          {"goals", std::move(goals)}};
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
       {{"on", options.guards},
        {"damped_ticks", 0},
        {"damping_max_N_s_per_m", 0},
        {"guarded_ticks", report.guarded_ticks},
        {"guard_least", report.guard_least},
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
  for (const PunctureEvent& event : report.punctures)
    summary["punctures"].push_back(describe(event, remesher));
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

std::string session_report_json(const Scene& scene, const SessionFigures& f,
                                const ReportFacts& facts) {
  json out = describe_goals(scene, f);
  out["schema"] = "trocar.session-report/1";
  out["trainee"] = parse_known_json(to_json(facts.trainee));
  out["program"] = "trocar-run " TROCAR_VERSION;
  out["use"] = "for training, not for planning";
  out["scene"] = scene.name;
  out["asset"] = scene.asset.filename().string();
  out["force_law"] = to_string(scene.force_law.kind);
  out["clock"] = facts.is_virtual ? "virtual" : "real";
  out["end"] = to_string(facts.result.end);
  out["rate_Hz"] = f.rate_Hz;
  out["ticks"] = f.ticks;
  out["ticks_counted"] = f.counted;
  out["ticks_lost"] = facts.result.ticks_not_observed;
  out["sheets"] = describe_sheets(facts);
  out["path"] = describe_path(f);
  out["time"] = describe_time(f);
  out["force"] = describe_force(f);
  out["punctures"] = describe_punctures(scene, f, facts);
  out["punctures_count"] = f.punctures.count;
  out["break_throughs"] = describe_break_throughs(scene, f, facts);
  out["break_throughs_count"] = f.break_throughs.count;
  out["plunge_max_m"] = f.plunge_max_m;
  out["tremor"] = {{"low_Hz", kTremorLow_Hz},
                   {"high_Hz", kTremorHigh_Hz},
                   {"settle_s", kTremorSettle_s},
                   {"free", describe(f.tremor_free)},
                   {"contact", describe(f.tremor_contact)}};
  out["attempts"] = describe_attempts(f);
  out["xray"] = {{"shots", facts.result.xray.shots},
                 {"screening_s", facts.result.xray.screening_s(f.rate_Hz)}};
  out["walls"] = describe_walls(f);
  out["walls"]["final"] = describe_final_wall(f, facts);
  out["faults"] = describe_faults(f, facts);
  out["faults_count"] = f.faults.count;
  out["operator_stops_count"] = f.operator_stops_count;
  out["goals"] = describe_results(f);
  out["goals_met"] = std::count_if(f.goals.begin(), f.goals.end(),
                                   [](const GoalResult& goal) { return goal.met; });
  out["goals_attempted"] = std::count_if(f.goals.begin(), f.goals.end(),
                                         [](const GoalResult& goal) { return goal.attempted; });
  out["samples"] = describe_samples(f);
  return json_text(out, 1);
}

std::string session_report_csv(const std::string& report_json) {
  json report = parse_known_json(report_json);
  report.erase("samples");
  std::string csv = "figure,value\n";
  const json flat = report.flatten();
  for (const auto& [path, value] : flat.items()) {
    std::string text = value.is_string() ? value.get<std::string>() : json_text(value);
    if (value.is_null() || value.is_structured()) text.clear();  // no value, or an empty list
    csv += csv_field(path.substr(1)) + ',' + csv_field(text) + '\n';
  }
  return csv;
}

std::string session_report_page(const Scene& scene, const SessionFigures& figures,
                                const ReportFacts& facts) {
  return html_page("trocar-run --session-report", kSessionPage,
                   {{"report", session_report_json(scene, figures, facts)},
                    {"drawing", json_text(describe_drawing(scene, figures, facts))}});
}

}  // namespace trocar::runtime
