// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/session_publisher.h"

#include <nlohmann/json.hpp>

#include "formats/base/json.h"
#include "formats/base/text.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

FrameDisplay::FrameDisplay(FrameFunction show, double frame_rate_Hz, double tick_rate_Hz,
                           const PrefetchWorker* prefetch)
    : TickObserver(std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / frame_rate_Hz))),
      show_(std::move(show)),
      frame_rate_Hz_(frame_rate_Hz),
      tick_rate_Hz_(tick_rate_Hz),
      prefetch_(prefetch) {}

void FrameDisplay::on_tick(const TickView& tick) noexcept {
  if (tick_rate_Hz_ > 0) {
    const double now_s = static_cast<double>(tick.state.tick - 1) / tick_rate_Hz_;
    if (now_s * frame_rate_Hz_ < static_cast<double>(frames_)) return;
    ++frames_;
  }
  latest_.write(tick.result.row);
}

void FrameDisplay::serve() {
  RecordingRow row;
  if (latest_.read(row)) show_(row, prefetch_ == nullptr ? nullptr : prefetch_->shape());
}

double shape_depth_m(const RecordingRow& row, const SheetShape& shape) noexcept {
  const bool held = row.phase == ContactPhase::kContact && row.active_slice == shape.slice_index;
  return held ? row.penetration_m : 0;
}

void FrameWriter::add(const RecordingRow& row, const std::shared_ptr<const SheetShape>& shape) {
  if (shape != nullptr && shape != last_) {
    const nlohmann::json line = {
        {"shape", shapes_++},  {"slice", shape->slice_index},     {"z_m", shape->z_m},
        {"cuts", shape->cuts}, {"vertices_m", shape->vertices_m}, {"triangles", shape->triangles},
        {"w", shape->w}};
    text_ += json_text(line) + "\n";
    last_ = shape;
  }
  nlohmann::json frame = {{"t_s", row.t_s},      {"state", to_string(row.phase)},
                          {"tip_m", row.tool_m}, {"wanted_z_N", row.wrench_wanted[2]},
                          {"shape", nullptr},    {"depth_m", 0.0}};
  if (last_ != nullptr) {
    frame["shape"] = shapes_ - 1;
    frame["depth_m"] = shape_depth_m(row, *last_);
  }
  text_ += json_text(frame) + "\n";
}

Result<void> FrameWriter::finish() const {
  return write_file_atomically(file_, text_);
}

FirstSheet::FirstSheet(const Sheet& sheet) {
  if (!sheet.hu || sheet.hu->size() != sheet.mesh.vertices.size()) return;
  mesh_ = sheet.mesh;
  grid_ = sheet.grid;
  hu_ = sheet.hu;
}

float FirstSheet::hu_at(LatticePoint point) const {
  // A rounded point may lie just outside of all triangles. Therefore the triangle in which it lies
  // deepest is used.
  const std::vector<float>& hu = *hu_;
  double deepest = -std::numeric_limits<double>::infinity();
  double found = 0;
  LatticeBox box{point, point};
  for (int margin = 2; margin <= 4096 && !std::isfinite(deepest); margin *= 8) {
    box = {{point.x - margin, point.y - margin}, {point.x + margin, point.y + margin}};
    grid_.for_each(mesh_, box, [&](std::uint32_t t) {
      const auto [a, b, c] = corners(mesh_, t);
      const auto area = static_cast<double>(orient2d(a, b, c));
      const std::array<double, 3> coordinate = {static_cast<double>(orient2d(b, c, point)) / area,
                                                static_cast<double>(orient2d(c, a, point)) / area,
                                                static_cast<double>(orient2d(a, b, point)) / area};
      const double depth = std::min({coordinate[0], coordinate[1], coordinate[2]});
      if (depth <= deepest) return;
      deepest = depth;
      const Triangle& v = mesh_.triangles[t];
      double sum = 0, weight = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        const double w = std::max(0.0, coordinate.at(i));
        sum += w * static_cast<double>(hu[v.at(i)]);
        weight += w;
      }
      found = sum / weight;
    });
  }
  return static_cast<float>(found);
}

TelemetrySheet FirstSheet::published(const Sheet& sheet) const {
  TelemetrySheet shown;
  shown.cuts = sheet.cuts;
  // Vertices are numbered in the order of their slots, as in to_slice_mesh(), so that a vertex of
  // the first mesh is found by its slot.
  std::vector<std::uint32_t> number(sheet.mesh.vertices.size(), kNoSlot);
  for (const Triangle& triangle : sheet.mesh.triangles) {
    if (triangle[0] == kNoSlot) continue;
    for (const std::uint32_t v : triangle)
      number[v] = 0;
  }
  std::uint32_t vertices = 0;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == kNoSlot) continue;
    number[v] = vertices++;
    const LatticePoint point = sheet.mesh.vertices[v];
    const Eigen::Vector2d at_m =
        sheet.transform.to_scene({static_cast<double>(point.x), static_cast<double>(point.y)});
    shown.xy_m.push_back(static_cast<float>(at_m.x()));
    shown.xy_m.push_back(static_cast<float>(at_m.y()));
    if (!has_hu()) continue;
    const bool is_first = v < hu_->size() && mesh_.vertices[v] == point;
    shown.hu.push_back(is_first ? (*hu_)[v] : hu_at(point));
  }
  for (const Triangle& triangle : sheet.mesh.triangles) {
    if (triangle[0] == kNoSlot) continue;
    for (const std::uint32_t v : triangle)
      shown.triangles.push_back(number[v]);
  }
  return shown;
}

namespace {

using nlohmann::json;

json describe_tool(const SceneTool& scene_tool) {
  // The corners are given about the axis, in the plate's x and y as if the tool were not tilted.
  SceneTool upright = scene_tool;
  upright.tilt_deg = 0;
  upright.tip_in_plate_m = {0, 0, 0};
  const Tool tool = make_tool(upright);
  json outline = json::array();
  for (int i = 0; i < tool.sides; ++i)
    outline.push_back({tool.corner_plate_m.at(i).x(), tool.corner_plate_m.at(i).y()});
  const Eigen::Vector3d axis = -make_tool(scene_tool).axis_plate;
  return {{"kind", scene_tool.kind.empty() ? "flat" : scene_tool.kind},
          {"half_angle_deg", scene_tool.half_angle_deg},
          {"radius_m", scene_tool.radius_m},
          {"outline_m", std::move(outline)},
          {"tip_in_plate_m", scene_tool.tip_in_plate_m},
          {"axis_in_plate", {axis.x(), axis.y(), axis.z()}}};
}

json describe_sheets(const Remesher& remesher, const TelemetryOptions& options) {
  json sheets = json::array();
  for (std::size_t i = 0; i < remesher.size(); ++i) {
    const Sheet& sheet = remesher.first_version(i);
    const bool has_name = i < options.tissue_of_sheet.size() && !options.tissue_of_sheet[i].empty();
    sheets.push_back({{"slice", sheet.slice_index},
                      {"z_m", sheet.z_m},
                      {"tissue", has_name ? json(options.tissue_of_sheet[i]) : json(nullptr)},
                      {"threshold_N", sheet.tissue.threshold_N}});
  }
  return sheets;
}

json describe_device(const DeviceSpecification& device, const SafetyLimits& limits) {
  const MotorsAndJoints parts = device.motors_and_joints();
  const auto number = [](const std::optional<double>& value) {
    return value ? json(*value) : json(nullptr);
  };
  return {{"motor_peak_torque_Nm", number(parts.motor_peak_torque_Nm)},
          {"motor_continuous_torque_Nm", number(parts.motor_continuous_torque_Nm)},
          {"joint_limits_rad", parts.joint_limits_rad},
          {"workspace",
           {{"min_m", limits.workspace_min_m},
            {"max_m", limits.workspace_max_m},
            {"tilt_max_rad", limits.plate_tilt_max_rad}}}};
}

json describe_hand(const std::optional<PublishedHand>& hand) {
  if (!hand) return nullptr;
  const auto numbers = [](const Eigen::Vector3d& v) {
    return std::array<double, 3>{v.x(), v.y(), v.z()};
  };
  const LiveHandLimits& limits = hand->limits;
  const Pose& start = limits.T_device_tool_start;
  return {{"live", true},
          {"box", {{"min_m", numbers(limits.min_m)}, {"max_m", numbers(limits.max_m)}}},
          {"start",
           {{"tip_m", numbers(start.p_m)}, {"rotation_rad", numbers(rotation_vector(start.q))}}},
          {"stiffness_N_per_m", hand->impedance.stiffness_N_per_m},
          {"rotation_stiffness_Nm_per_rad", hand->impedance.rotational_stiffness_Nm_per_rad},
          {"speed_max_m_per_s", limits.speed_max_m_per_s},
          {"rotation_rate_max_rad_per_s", limits.rotation_rate_max_rad_per_s},
          {"turn_max_rad", limits.turn_max_rad}};
}

const char* clock_name(const SessionOptions& options) {
  if (!options.replay.empty()) return "replay";
  return options.clock == Clock::kReal ? "real" : "virtual";
}

/// Converts a shape, which is the deformed sheet around the tool. `slices`: the slice index of each
/// sheet. If the shape's slice is not in `slices`, TelemetryShape::sheet of the result is -1.
TelemetryShape published(const SheetShape& shape, const std::vector<std::int32_t>& slices) {
  TelemetryShape shown;
  const auto sheet = std::find(slices.begin(), slices.end(), shape.slice_index);
  shown.sheet = sheet == slices.end() ? -1 : static_cast<std::int32_t>(sheet - slices.begin());
  shown.cuts = shape.cuts;
  shown.z_m = shape.z_m;
  for (std::size_t i = 0; i < shape.vertices_m.size(); ++i) {
    for (const double x : {shape.vertices_m[i][0], shape.vertices_m[i][1], shape.w[i]})
      shown.xyw.push_back(static_cast<float>(x));
  }
  for (const Triangle& triangle : shape.triangles)
    shown.triangles.insert(shown.triangles.end(), triangle.begin(), triangle.end());
  return shown;
}

/// The values from which the columns are computed. `tick_times`: durations of ticks. `wake_times`:
/// delays of the haptic thread's wake-ups. `last_event`: number of the last event written.
struct SnapshotSource {
  const TelemetryTick& tick;
  const Tool& tool;
  const TelemetryHistogram& tick_times;
  const TelemetryHistogram& wake_times;
  std::uint64_t last_event = 0;
  double recording_left_s = std::numeric_limits<double>::infinity();  ///< Recorder::left_s()
};

struct Column {
  const char* name;
  std::size_t count;
  void (*fill)(const SnapshotSource& source, double* values);
};

template <typename Get>
constexpr Column one(const char* name, Get) {
  return {name, 1,
          [](const SnapshotSource& s, double* values) { *values = static_cast<double>(Get{}(s)); }};
}

/// Makes a column of `count` numbers. `Get` returns an array or another range.
template <typename Get>
constexpr Column many(const char* name, std::size_t count, Get) {
  return {name, count, [](const SnapshotSource& s, double* values) {
            for (const auto value : Get{}(s))
              *values++ = static_cast<double>(value);
          }};
}

Eigen::Vector3d axis_of(const SnapshotSource& s) {
  const std::array<double, 4>& q = s.tick.row.q;
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]) * -s.tool.axis_plate;
}

std::array<double, kMaxSceneSlices> bits_of(std::uint64_t bits) {
  std::array<double, kMaxSceneSlices> values;
  for (unsigned i = 0; i < kMaxSceneSlices; ++i)
    values[i] = static_cast<double>(bits >> i & 1U);
  return values;
}

std::array<double, TelemetryHistogram::kBins> counts_of(const TelemetryHistogram& histogram) {
  std::array<double, TelemetryHistogram::kBins> counts;
  for (std::size_t i = 0; i < counts.size(); ++i)
    counts[i] = static_cast<double>(histogram.count(i));
  return counts;
}

using S = SnapshotSource;
constexpr Column kColumns[] = {
    one("t_s", [](const S& s) { return s.tick.row.t_s; }),
    one("taken_at_s", [](const S& s) { return static_cast<double>(s.tick.taken_ns) * 1e-9; }),
    many("p_m", 3, [](const S& s) { return s.tick.row.p_m; }),
    many("q", 4, [](const S& s) { return s.tick.row.q; }),
    many("tool_m", 3, [](const S& s) { return s.tick.row.tool_m; }),
    many("axis", 3, [](const S& s) { return axis_of(s); }),
    many("wrench_wanted", 6, [](const S& s) { return s.tick.row.wrench_wanted; }),
    many("wrench_delivered", 6, [](const S& s) { return s.tick.row.wrench_delivered; }),
    many("tau_Nm", kMaxCommanded, [](const S& s) { return s.tick.row.tau_Nm; }),
    many("tau_limit_Nm", kMaxCommanded, [](const S& s) { return s.tick.readout.command_limit; }),
    many("motor_angle_rad", kMaxMeasured, [](const S& s) { return s.tick.row.encoder_rad; }),
    one("joint_margin", [](const S& s) { return s.tick.readout.margin; }),
    one("phase", [](const S& s) { return s.tick.row.phase; }),
    one("active_slice", [](const S& s) { return s.tick.row.active_slice; }),
    one("active_sheet", [](const S& s) { return s.tick.active_sheet; }),
    one("penetration_m", [](const S& s) { return s.tick.row.penetration_m; }),
    one("wrench_scale", [](const S& s) { return s.tick.row.wrench_scale; }),
    one("pose_residual_m", [](const S& s) { return s.tick.row.pose_residual_m; }),
    one("cuts_published", [](const S& s) { return s.tick.row.cuts_published; }),
    one("fault", [](const S& s) { return s.tick.row.fault; }),
    one("safety", [](const S& s) { return s.tick.row.safety; }),
    one("authority", [](const S& s) { return s.tick.row.authority; }),
    one("guard", [](const S& s) { return s.tick.row.guard; }),
    one("passivity_J", [](const S& s) { return s.tick.row.passivity_J; }),
    one("motor_heat_max", [](const S& s) { return s.tick.row.motor_heat_max; }),
    one("ticks", [](const S& s) { return s.tick.ticks; }),
    one("missed_deadlines", [](const S& s) { return s.tick.missed_deadlines; }),
    many("missed_by", kTickParts, [](const S& s) { return s.tick.late_ticks; }),
    one("late_max_us", [](const S& s) { return static_cast<double>(s.tick.late_max_ns) * 1e-3; }),
    one("front_z_m", [](const S& s) { return s.tick.row.cutting.front_z_m; }),
    one("front_HU", [](const S& s) { return s.tick.row.cutting.front_HU; }),
    one("tip_N", [](const S& s) { return s.tick.row.tip_N; }),
    one("embedded_m", [](const S& s) { return s.tick.row.cutting.embedded_m; }),
    one("cut_J", [](const S& s) { return s.tick.row.cutting.cut_J; }),
    one("absorbed_J", [](const S& s) { return s.tick.row.cutting.absorbed_J; }),
    one("stored_J", [](const S& s) { return s.tick.row.cutting.stored_J; }),
    one("punctures", [](const S& s) { return s.tick.punctures; }),
    one("break_throughs", [](const S& s) { return s.tick.break_throughs; }),
    one("faults", [](const S& s) { return s.tick.faults; }),
    one("events", [](const S& s) { return s.last_event; }),
    one("xray_shots", [](const S& s) { return s.tick.xray_shots; }),
    one("xray_screening_s", [](const S& s) { return s.tick.xray_screening_s; }),
    one("recording_left_s", [](const S& s) { return s.recording_left_s; }),
    one("paused", [](const S& s) { return s.tick.is_paused; }),
    one("ended", [](const S& s) { return s.tick.has_ended; }),
    many("tick_us", TelemetryHistogram::kBins, [](const S& s) { return counts_of(s.tick_times); }),
    many("wake_us", TelemetryHistogram::kBins, [](const S& s) { return counts_of(s.wake_times); }),
    many("sheet_cuts", kMaxSceneSlices, [](const S& s) { return s.tick.sheet_cuts; }),
    many("sheet_touched", kMaxSceneSlices,
         [](const S& s) { return bits_of(s.tick.sheets_touched); }),
    many("sheet_punctured", kMaxSceneSlices,
         [](const S& s) { return bits_of(s.tick.sheets_punctured); }),
};

std::size_t snapshot_size() {
  std::size_t size = 0;
  for (const Column& column : kColumns)
    size += column.count;
  return size;
}

void snapshot_values(const SnapshotSource& source, std::span<double> values) {
  std::size_t next = 0;
  for (const Column& column : kColumns) {
    column.fill(source, values.subspan(next, column.count).data());
    next += column.count;
  }
}

}  // namespace

std::string session_facts(const Scene& scene, const DeviceSpecification& device,
                          const Remesher& remesher, const SessionOptions& options) {
  const TelemetryOptions& told = *options.telemetry;
  json about = {
      {"schema", kTelemetrySchema},
      {"program", "trocar-run " TROCAR_VERSION},
      {"pid", ::getpid()},
      {"started_at", utc_text(std::time(nullptr))},
      {"scene", {{"file", told.scene_file}, {"name", scene.name}}},
      {"asset", scene.asset.string()},
      {"device", told.device},
      {"force_law", to_string(scene.force_law.kind)},
      {"rate_Hz", options.rate_Hz},
      {"duration_s", options.duration_s},
      {"clock", clock_name(options)},
      {"recovery", told.recovery},
      {"record", options.record ? json(options.record->string()) : json(nullptr)},
      {"xray", options.counts_xray && options.replay.empty()},
      {"tool", describe_tool(scene.tool)},
      {"hand", describe_hand(told.hand)},
      {"sheets", describe_sheets(remesher, told)},
      {"layers", json::array()},
      {"columns", json::array()},
      {"phases", names_of<ContactPhase>(static_cast<int>(ContactPhase::kFault) + 1)},
      {"faults", names_of<Fault>(kFaults)},
      {"safety_states", names_of<SafetyState>(kSafetyStates)},
  };
  about.update(describe_device(device, options.limits));
  for (const SceneLayer& layer : scene.layers) {
    about["layers"].push_back({{"name", layer.name},
                               {"top_z_m", layer.top_z_m},
                               {"thickness_m", layer.thickness_m},
                               {"puncture_N", layer.puncture_N}});
  }
  for (const Column& column : kColumns)
    about["columns"].push_back({{"name", column.name}, {"count", column.count}});
  json edges = json::array();
  for (std::size_t i = 0; i <= TelemetryHistogram::kBins; ++i)
    edges.push_back(TelemetryHistogram::lower_us(i));
  about["histogram_edges_us"] = std::move(edges);
  return json_text(about);
}

SessionPublisher::SessionPublisher() : TickObserver(std::chrono::milliseconds(4)) {}

Result<std::unique_ptr<SessionPublisher>> SessionPublisher::make(
    const Scene& scene, const DeviceSpecification& device, const Remesher& remesher,
    const PrefetchWorker* prefetch, const SessionOptions& options, const Recorder* recorder) {
  std::unique_ptr<SessionPublisher> made(new SessionPublisher);
  made->prefetch_ = prefetch;
  made->recorder_ = recorder;
  made->rate_Hz_ = options.rate_Hz;
  made->tool_ = make_tool(scene.tool);
  made->values_.resize(snapshot_size());
  TelemetrySizes sizes{.about = session_facts(scene, device, remesher, options),
                       .columns = snapshot_size(),
                       .has_shape = prefetch != nullptr,
                       .has_hand = options.telemetry->hand.has_value()};
  for (std::size_t i = 0; i < remesher.size(); ++i) {
    const Sheet& sheet = remesher.first_version(i);
    const FirstSheet& first = made->first_.emplace_back(sheet);
    sizes.sheets.push_back(
        {sheet.mesh.vertices_in_use(), sheet.mesh.triangles_in_use(), first.has_hu()});
    made->slices_.push_back(sheet.slice_index);
  }
  made->published_cuts_.assign(remesher.size(), -1);
  if (const auto ok = TelemetryWriter::make(sizes).into(made->writer_); !ok) return ok.error();
  made->publish_sheets(remesher);
  made->write(TelemetryTick{});
  if (Result<void> linked = made->writer_->link(options.telemetry->file); !linked)
    return linked.error();
  return made;
}

TelemetryCommands SessionPublisher::take_commands() noexcept {
  const auto given = [this](TelemetryCommand command) {
    const std::uint64_t count = writer_->commands(command);
    return count != std::exchange(taken_[static_cast<std::size_t>(command)], count);
  };
  // Shots are counted: two of them between two ticks are two.
  constexpr auto kShots = static_cast<std::size_t>(TelemetryCommand::kXrayShot);
  const std::uint64_t shots = writer_->commands(TelemetryCommand::kXrayShot);
  return {.stop = given(TelemetryCommand::kStop),
          .pause = given(TelemetryCommand::kPause),
          .resume = given(TelemetryCommand::kResume),
          .zero = given(TelemetryCommand::kZero),
          .recover = given(TelemetryCommand::kRecover),
          .emergency_stop = given(TelemetryCommand::kEmergencyStop),
          .xray_shots = shots - std::exchange(taken_[kShots], shots),
          .screening = writer_->screening()};
}

void SessionPublisher::push(const TelemetryEvent& event) noexcept {
  if (!events_.push(event)) lost_events_.fetch_add(1, std::memory_order_relaxed);
}

void SessionPublisher::push_event(TelemetryEventKind kind, double t_s) noexcept {
  push({.kind = kind, .t_s = t_s});
}

void SessionPublisher::on_puncture(const PunctureEvent& puncture) noexcept {
  ++tick_.punctures;
  tick_.sheets_punctured |= std::uint64_t{1} << static_cast<unsigned>(puncture.sheet);
  push({.kind = TelemetryEventKind::kPuncture,
        .t_s = puncture.t_s,
        .sheet = puncture.sheet,
        .slice = puncture.slice,
        .cut = puncture.cut,
        .tool_z_m = puncture.tool_z_m,
        .penetration_m = puncture.penetration_m,
        .tip_N = puncture.tip_N,
        .trial_force_N = puncture.trial_force_N,
        .hand_N = puncture.hand_N});
}

void SessionPublisher::on_break_through(const BreakThroughEvent& found) noexcept {
  ++tick_.break_throughs;
  push({.kind = TelemetryEventKind::kBreakThrough,
        .t_s = found.t_s,
        .sheet = found.sheet,
        .slice = found.at,
        .tool_z_m = found.tool_z_m,
        .tip_N = found.resistance_N});
}

void SessionPublisher::on_message(const OperatorMessage& message) noexcept {
  using Kind = OperatorMessage::Kind;
  push({.kind = message.kind == Kind::kFault       ? TelemetryEventKind::kFault
                : message.kind == Kind::kRecovered ? TelemetryEventKind::kRecovered
                : message.kind == Kind::kRefused   ? TelemetryEventKind::kRecoveryRefused
                : message.kind == Kind::kSoftened  ? TelemetryEventKind::kSoftened
                                                   : TelemetryEventKind::kNotRecovered,
        .t_s = message.t_s,
        .found = message.detail,
        .retract_distance_m = message.retract_distance_m});
}

void SessionPublisher::count_xray(const RecordingRow& row) noexcept {
  const bool was_screening = xray_.is_screening;
  xray_.add(row);
  if ((row.xray & kXrayPicture) != 0) push_event(TelemetryEventKind::kXrayShot, row.t_s);
  if (xray_.is_screening != was_screening)
    push_event(was_screening ? TelemetryEventKind::kXrayOff : TelemetryEventKind::kXrayOn, row.t_s);
  tick_.xray_shots = xray_.shots;
  tick_.xray_screening_s = xray_.screening_s(rate_Hz_);
}

void SessionPublisher::on_tick(const TickView& view) noexcept {
  count_xray(view.result.row);
  tick_times_.add(monotonic_ns() - view.start_ns);
  if (view.is_real_time) wake_times_.add(view.timing.late_ns);
  const ContactOutput& contact = view.result.contact;
  tick_.row = view.result.row;
  tick_.taken_ns = view.start_ns;
  tick_.readout = view.result.readout;
  tick_.active_sheet = contact.active_sheet;
  tick_.ticks = view.state.tick;
  tick_.missed_deadlines = view.timing.missed_deadlines;
  tick_.late_ticks = view.late_ticks;
  tick_.late_max_ns = std::max(tick_.late_max_ns, view.timing.late_ns);
  if (view.result.new_fault != Fault::kNone) ++tick_.faults;
  if (contact.phase == ContactPhase::kContact && contact.active_sheet >= 0)
    tick_.sheets_touched |= std::uint64_t{1} << static_cast<unsigned>(contact.active_sheet);
  for (std::size_t i = 0; i < view.sheets.size(); ++i)
    tick_.sheet_cuts[i] = view.sheets[i]->cuts;
  tick_.is_paused = false;
  ticks_.write(tick_);
}

void SessionPublisher::end_screening() noexcept {
  if (std::exchange(xray_.is_screening, false))
    push_event(TelemetryEventKind::kXrayOff, tick_.row.t_s);
}

void SessionPublisher::on_paused_period(std::int64_t now_ns) noexcept {
  end_screening();
  tick_.is_paused = true;
  tick_.taken_ns = now_ns;
  ticks_.write(tick_);
}

void SessionPublisher::publish_sheets(const Remesher& remesher) {
  for (std::size_t i = 0; i < published_cuts_.size(); ++i) {
    const Sheet& sheet = remesher.published_version(i);
    if (sheet.cuts == published_cuts_[i]) continue;
    writer_->sheet(i, first_[i].published(sheet));
    published_cuts_[i] = sheet.cuts;
    if (sheet.cuts == 0) continue;
    TelemetryEvent event{.kind = TelemetryEventKind::kCutShown,
                         .t_s = last_t_s_.load(std::memory_order_relaxed),
                         .sheet = static_cast<std::int32_t>(i),
                         .slice = sheet.slice_index,
                         .cut = sheet.cuts};
    if (!sheet_events_.push(event)) lost_events_.fetch_add(1, std::memory_order_relaxed);
  }
}

void SessionPublisher::publish_shape() {
  if (prefetch_ == nullptr) return;
  std::shared_ptr<const SheetShape> latest = prefetch_->shape();
  if (latest == nullptr || latest == shape_) return;
  shape_ = std::move(latest);
  TelemetryShape shape = published(*shape_, slices_);
  shape.version = ++shapes_;
  writer_->shape(shape);
}

void SessionPublisher::write(const TelemetryTick& tick) {
  SnapshotSource source{tick, tool_, tick_times_, wake_times_, writer_->last_event()};
  if (recorder_ != nullptr) source.recording_left_s = recorder_->left_s();
  snapshot_values(source, values_);
  writer_->snapshot(values_);
}

void SessionPublisher::serve() {
  if (writer_ == nullptr) return;
  TelemetryEvent event;
  while (events_.pop(event))
    writer_->event(event);
  while (sheet_events_.pop(event))
    writer_->event(event);
  writer_->lose_events(lost_events_.exchange(0, std::memory_order_relaxed));
  publish_shape();
  TelemetryTick tick;
  if (!ticks_.read(tick)) return;
  last_t_s_.store(tick.row.t_s, std::memory_order_relaxed);
  write(tick);
}

void SessionPublisher::end(TelemetryEnd end, Fault fault, const Remesher& remesher) {
  publish_sheets(remesher);
  end_screening();
  stop();  // so that kEnded is the last event
  push({.kind = TelemetryEventKind::kEnded, .end = end, .t_s = tick_.row.t_s, .found = fault});
  tick_.is_paused = false;
  tick_.has_ended = true;
  for (std::size_t i = 0; i < remesher.size(); ++i)
    tick_.sheet_cuts[i] = remesher.last_version(i).cuts;
  ticks_.write(tick_);
  serve();
}

}  // namespace trocar::runtime
