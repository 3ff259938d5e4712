// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/live_view.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <ctime>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "formats/base/json_text.h"
#include "runtime/session/session.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

constexpr std::chrono::milliseconds kPollInterval{4};
constexpr unsigned kFirstOctave = 8;  // 256 ns

struct Column {
  const char* name;
  std::size_t count = 1;
};
// In the order of LiveView::write().
constexpr std::array kColumns{
    Column{"t_s"},
    Column{"taken_at_s"},
    Column{"p_m", 3},
    Column{"q", 4},
    Column{"tool_m", 3},
    Column{"axis", 3},
    Column{"wrench_wanted", 6},
    Column{"wrench_delivered", 6},
    Column{"tau_Nm", kMotors},
    Column{"tau_limit_Nm", kMotors},
    Column{"motor_angle_rad", kEncoders},
    Column{"joint_margin"},
    Column{"phase"},
    Column{"active_slice"},
    Column{"active_sheet"},
    Column{"penetration_m"},
    Column{"force_N"},
    Column{"wrench_scale"},
    Column{"pose_residual_m"},
    Column{"cuts_published"},
    Column{"fault"},
    Column{"safety"},
    Column{"authority"},
    Column{"passivity_J"},
    Column{"motor_heat_max"},
    Column{"ticks"},
    Column{"missed_deadlines"},
    Column{"late_max_us"},
    Column{"front_z_m"},
    Column{"front_HU"},
    Column{"tip_N"},
    Column{"embedded_m"},
    Column{"cut_J"},
    Column{"absorbed_J"},
    Column{"stored_J"},
    Column{"punctures"},
    Column{"faults"},
    Column{"events"},
    Column{"paused"},
    Column{"ended"},
    Column{"tick_us", LiveHistogram::kBins},
    Column{"wake_us", LiveHistogram::kBins},
    Column{"sheet_cuts", kMaxSceneSlices},
    Column{"sheet_touched", kMaxSceneSlices},
    Column{"sheet_punctured", kMaxSceneSlices},
};

constexpr std::size_t column_count() {
  std::size_t count = 0;
  for (const Column& column : kColumns)
    count += column.count;
  return count;
}

/// UTC, RFC 3339.
std::string now_text() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text.data();
}

json describe_tool(const SceneTool& scene_tool) {
  // Corners about the axis, in the plate's x and y if the tool is not tilted.
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

json describe_sheets(const Remesher& remesher, const LiveOptions& live) {
  json sheets = json::array();
  for (std::size_t i = 0; i < remesher.size(); ++i) {
    const Sheet& sheet = remesher.first_version(i);
    const bool has_name = i < live.tissue_of_sheet.size() && !live.tissue_of_sheet[i].empty();
    sheets.push_back({{"slice", sheet.slice_index},
                      {"z_m", sheet.z_m},
                      {"tissue", has_name ? json(live.tissue_of_sheet[i]) : json(nullptr)},
                      {"threshold_N", sheet.tissue.threshold_N}});
  }
  return sheets;
}

json describe_device(const DeviceDescription& device, const SafetyLimits& limits) {
  json joints = json::array();
  for (const JointLimit& limit : device.joint_limit)
    joints.push_back({limit.min_rad, limit.max_rad});
  return {{"motor_peak_torque_Nm", device.motor_peak_torque_Nm},
          {"motor_continuous_torque_Nm", device.motor_continuous_torque_Nm},
          {"joint_limits_rad", std::move(joints)},
          {"workspace",
           {{"min_m", limits.workspace_min_m},
            {"max_m", limits.workspace_max_m},
            {"tilt_max_rad", limits.plate_tilt_max_rad}}}};
}

std::string describe_session(const Scene& scene, const DeviceDescription& description,
                             const Remesher& remesher, const SessionOptions& options) {
  const LiveOptions& live = *options.live_memory;
  json about = {
      {"schema", kLiveSchema},
      {"program", "trocar-run " TROCAR_VERSION},
      {"pid", ::getpid()},
      {"started_at", now_text()},
      {"scene", {{"file", live.scene_file}, {"name", scene.name}}},
      {"asset", scene.asset.string()},
      {"device", live.device},
      {"force_law", to_string(scene.force_law.kind)},
      {"rate_Hz", options.rate_Hz},
      {"duration_s", options.duration_s},
      {"clock", !options.replay.empty()         ? "replay"
                : options.clock == Clock::kReal ? "real"
                                                : "virtual"},
      {"recovery", live.recovery},
      {"record", options.record ? json(options.record->string()) : json(nullptr)},
      {"tool", describe_tool(scene.tool)},
      {"sheets", describe_sheets(remesher, live)},
      {"layers", json::array()},
      {"columns", json::array()},
      {"phases", names_of<ContactPhase>(static_cast<int>(ContactPhase::kFault) + 1)},
      {"faults", names_of<Fault>(kFaults)},
      {"safety_states", names_of<SafetyState>(kSafetyStates)},
  };
  about.update(describe_device(description, options.limits));
  for (const SceneLayer& layer : scene.layers) {
    about["layers"].push_back({{"name", layer.name},
                               {"top_z_m", layer.top_z_m},
                               {"thickness_m", layer.thickness_m},
                               {"puncture_N", layer.puncture_N}});
  }
  for (const Column& column : kColumns)
    about["columns"].push_back({{"name", column.name}, {"count", column.count}});
  json edges = json::array();
  for (std::size_t i = 0; i <= LiveHistogram::kBins; ++i)
    edges.push_back(LiveHistogram::lower_us(i));
  about["histogram_edges_us"] = std::move(edges);
  return json_text(about);
}

/// The smallest distance of an angle to a limit; below 0 beyond it.
double joint_margin_rad(const DeviceDescription& device,
                        const std::array<double, kEncoders>& encoder_rad) {
  double margin = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < encoder_rad.size(); ++i) {
    const JointLimit& limit = device.joint_limit.at(i % 4);
    margin = std::min({margin, encoder_rad[i] - limit.min_rad, limit.max_rad - encoder_rad[i]});
  }
  return margin;
}

}  // namespace

std::size_t LiveHistogram::bin(std::int64_t duration_ns) noexcept {
  if (duration_ns < std::int64_t{1} << kFirstOctave) return 0;
  const auto value = static_cast<std::uint64_t>(duration_ns);
  const unsigned octave = static_cast<unsigned>(std::bit_width(value)) - 1;
  const std::uint64_t quarter = (value >> (octave - 2)) & 3U;
  return std::min<std::size_t>(std::size_t{4} * (octave - kFirstOctave) + quarter, kBins - 1);
}

double LiveHistogram::lower_us(std::size_t i) noexcept {
  if (i == 0) return 0;
  return std::ldexp(1 + 0.25 * static_cast<double>(i % 4), static_cast<int>(kFirstOctave + i / 4)) *
         1e-3;
}

Result<std::unique_ptr<LiveView>> LiveView::make(const Scene& scene,
                                                 const DeviceDescription& description,
                                                 const Remesher& remesher,
                                                 const Responder* responder,
                                                 const SessionOptions& options) {
  std::unique_ptr<LiveView> view(new LiveView);
  view->responder_ = responder;
  view->description_ = description;
  view->motor_ = make_motor_model(description);
  view->tool_ = make_tool(scene.tool);
  view->values_.resize(column_count());
  LiveSizes sizes;
  sizes.about = describe_session(scene, description, remesher, options);
  sizes.columns = column_count();
  sizes.has_shape = responder != nullptr;
  for (std::size_t i = 0; i < remesher.size(); ++i) {
    const Sheet& sheet = remesher.first_version(i);
    const bool has_hu = sheet.hu && sheet.hu->size() == sheet.mesh.vertices.size();
    sizes.sheets.push_back({sheet.mesh.vertices_in_use(), sheet.mesh.triangles_in_use(), has_hu});
    FirstSheet& first = view->first_.emplace_back();
    if (has_hu) first = {sheet.mesh, TriangleGrid(sheet.mesh), sheet.hu};
    view->slices_.push_back(sheet.slice_index);
  }
  view->shown_cuts_.assign(remesher.size(), -1);
  auto writer = LiveWriter::make(sizes);
  if (!writer) return writer.error();
  view->writer_ = std::move(*writer);
  view->show_sheets(remesher);
  view->write(LiveTick{});
  if (Result<void> linked = view->writer_->link(options.live_memory->file); !linked)
    return linked.error();
  return view;
}

LiveView::~LiveView() {
  stop();
}

float LiveView::hu_at(const FirstSheet& first, LatticePoint point) const {
  // Of the triangles at the point the one in which it lies deepest: rounded points may lie just
  // outside of all.
  const std::vector<float>& hu = *first.hu;
  double deepest = -std::numeric_limits<double>::infinity();
  double found = 0;
  LatticeBox box{point, point};
  for (int margin = 2; margin <= 4096 && !std::isfinite(deepest); margin *= 8) {
    box = {{point.x - margin, point.y - margin}, {point.x + margin, point.y + margin}};
    first.grid.for_each(box, [&](std::uint32_t t) {
      const auto [a, b, c] = corners(first.mesh, t);
      const auto area = static_cast<double>(orient2d(a, b, c));
      const std::array<double, 3> share = {static_cast<double>(orient2d(b, c, point)) / area,
                                           static_cast<double>(orient2d(c, a, point)) / area,
                                           static_cast<double>(orient2d(a, b, point)) / area};
      const double depth = std::min({share[0], share[1], share[2]});
      if (depth <= deepest) return;
      deepest = depth;
      const Triangle& v = first.mesh.triangles[t];
      double sum = 0, weight = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        const double w = std::max(0.0, share.at(i));
        sum += w * static_cast<double>(hu[v.at(i)]);
        weight += w;
      }
      found = sum / weight;
    });
  }
  return static_cast<float>(found);
}

void LiveView::show_sheet(std::size_t index, const Sheet& sheet) {
  const FirstSheet& first = first_[index];
  LiveSheet shown;
  shown.cuts = sheet.cuts;
  // As to_slice_mesh(): by slots, so that a vertex of the first mesh is found by its slot.
  std::vector<std::uint32_t> number(sheet.mesh.vertices.size(), kNone);
  for (const Triangle& triangle : sheet.mesh.triangles) {
    if (triangle[0] == kNone) continue;
    for (const std::uint32_t v : triangle)
      number[v] = 0;
  }
  std::uint32_t vertices = 0;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == kNone) continue;
    number[v] = vertices++;
    const LatticePoint point = sheet.mesh.vertices[v];
    const Eigen::Vector2d at_m =
        sheet.transform.to_scene({static_cast<double>(point.x), static_cast<double>(point.y)});
    shown.xy_m.push_back(static_cast<float>(at_m.x()));
    shown.xy_m.push_back(static_cast<float>(at_m.y()));
    if (!first.hu) continue;
    const bool is_old = v < first.hu->size() && first.mesh.vertices[v] == point;
    shown.hu.push_back(is_old ? (*first.hu)[v] : hu_at(first, point));
  }
  for (const Triangle& triangle : sheet.mesh.triangles) {
    if (triangle[0] == kNone) continue;
    for (const std::uint32_t v : triangle)
      shown.triangles.push_back(number[v]);
  }
  writer_->sheet(index, shown);
  shown_cuts_[index] = sheet.cuts;
  if (sheet.cuts == 0) return;
  LiveEvent event;
  event.kind = LiveEventKind::kCutShown;
  event.t_s = last_t_s_.load(std::memory_order_relaxed);
  event.sheet = static_cast<std::int32_t>(index);
  event.slice = sheet.slice_index;
  event.cut = sheet.cuts;
  if (!shown_.push(event)) lost_.fetch_add(1, std::memory_order_relaxed);
}

void LiveView::show_sheets(const Remesher& remesher) {
  for (std::size_t i = 0; i < shown_cuts_.size(); ++i) {
    const Sheet& sheet = remesher.published_version(i);
    if (sheet.cuts != shown_cuts_[i]) show_sheet(i, sheet);
  }
}

void LiveView::show_shape() {
  if (responder_ == nullptr) return;
  const std::shared_ptr<const SheetShape> latest = responder_->shape();
  if (latest == nullptr || latest == shape_) return;
  shape_ = latest;
  LiveShape shown;
  shown.version = ++shapes_;
  const auto sheet = std::find(slices_.begin(), slices_.end(), latest->slice_index);
  shown.sheet = sheet == slices_.end() ? -1 : static_cast<std::int32_t>(sheet - slices_.begin());
  shown.cuts = latest->cuts;
  shown.z_m = latest->z_m;
  for (std::size_t i = 0; i < latest->vertices_m.size(); ++i) {
    for (const double x : {latest->vertices_m[i][0], latest->vertices_m[i][1], latest->w[i]})
      shown.xyw.push_back(static_cast<float>(x));
  }
  for (const Triangle& triangle : latest->triangles)
    shown.triangles.insert(shown.triangles.end(), triangle.begin(), triangle.end());
  writer_->shape(shown);
}

void LiveView::write(const LiveTick& tick) {
  const RecordingRow& row = tick.row;
  auto next = values_.begin();
  const auto put = [&](double value) { *next++ = value; };
  const auto put_all = [&](const auto& list) {
    for (const auto value : list)
      put(static_cast<double>(value));
  };
  const auto put_bits = [&](std::uint64_t bits) {
    for (unsigned i = 0; i < kMaxSceneSlices; ++i)
      put(static_cast<double>(bits >> i & 1U));
  };
  const Eigen::Vector3d axis =
      Eigen::Quaterniond(row.q[0], row.q[1], row.q[2], row.q[3]) * -tool_.axis_plate;
  MotorLoad load;
  std::copy(tick.motor_load_A2s.begin(), tick.motor_load_A2s.end(), load.excess_A2s.data());
  const MotorVector limit_Nm = available_torque(motor_, load);
  put(row.t_s);
  put(static_cast<double>(tick.taken_ns) * 1e-9);
  put_all(row.p_m);
  put_all(row.q);
  put_all(row.tool_m);
  put_all(std::array{axis.x(), axis.y(), axis.z()});
  put_all(row.wrench_wanted);
  put_all(row.wrench_delivered);
  put_all(row.tau_Nm);
  for (int i = 0; i < kMotors; ++i)
    put(limit_Nm[i]);
  put_all(row.encoder_rad);
  put(joint_margin_rad(description_, row.encoder_rad));
  put(static_cast<double>(row.phase));
  put(row.active_slice);
  put(tick.active_sheet);
  put(row.penetration_m);
  put(tick.force_N);
  put(row.wrench_scale);
  put(row.pose_residual_m);
  put(static_cast<double>(row.cuts_published));
  put(static_cast<double>(row.fault));
  put(static_cast<double>(row.safety));
  put(row.authority);
  put(row.passivity_J);
  put(row.motor_heat_max);
  put(static_cast<double>(tick.ticks));
  put(static_cast<double>(tick.missed_deadlines));
  put(static_cast<double>(tick.late_max_ns) * 1e-3);
  put(row.cutting.front_z_m);
  put(row.cutting.front_HU);
  put(row.cutting.tip_N);
  put(row.cutting.embedded_m);
  put(row.cutting.cut_J);
  put(row.cutting.absorbed_J);
  put(row.cutting.stored_J);
  put(static_cast<double>(tick.punctures));
  put(static_cast<double>(tick.faults));
  put(static_cast<double>(writer_->last_event()));
  put(tick.is_paused ? 1 : 0);
  put(tick.has_ended ? 1 : 0);
  for (std::size_t i = 0; i < LiveHistogram::kBins; ++i)
    put(static_cast<double>(tick_times_.count(i)));
  for (std::size_t i = 0; i < LiveHistogram::kBins; ++i)
    put(static_cast<double>(wake_times_.count(i)));
  put_all(tick.sheet_cuts);
  put_bits(tick.sheets_touched);
  put_bits(tick.sheets_punctured);
  writer_->snapshot(values_);
}

void LiveView::serve() {
  LiveEvent event;
  while (events_.pop(event))
    writer_->event(event);
  while (shown_.pop(event))
    writer_->event(event);
  writer_->lose_events(lost_.exchange(0, std::memory_order_relaxed));
  show_shape();
  LiveTick tick;
  if (!ticks_.read(tick)) return;
  last_t_s_.store(tick.row.t_s, std::memory_order_relaxed);
  write(tick);
}

void LiveView::start() {
  stopping_.store(false);
  thread_ = std::thread([this] {
    while (!stopping_.load(std::memory_order_acquire)) {
      serve();
      std::this_thread::sleep_for(kPollInterval);
    }
  });
}

void LiveView::stop() {
  if (thread_.joinable()) {
    stopping_.store(true, std::memory_order_release);
    thread_.join();
  }
  if (writer_ != nullptr) serve();
}

}  // namespace trocar::runtime
