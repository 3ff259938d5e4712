// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/bone_volume.h"

namespace trocar::runtime {
namespace {

constexpr double kPi = std::numbers::pi;

// True if the tip is flat or hollow, so that it stamps its outline out of the material.
bool is_flat(const ToolShape& tool) noexcept {
  return tool.inner_radius_m > 0 || tool.half_angle_rad >= kPi / 2;
}

// Returns the density, which is at least 0. Its kind is the one that the calibration names.
double density_of(const HuCalibration& calibration, double HU) noexcept {
  return std::max(0.0, calibration.at_0_HU + calibration.per_HU * HU);
}

constexpr std::array<std::pair<ToolKind, std::string_view>, 5> kNames{{
    {ToolKind::kNeedleBevel, "needle-bevel"},
    {ToolKind::kNeedleConical, "needle-conical"},
    {ToolKind::kNeedleDiamond, "needle-diamond"},
    {ToolKind::kTrocar, "trocar"},
    {ToolKind::kJamshidi, "jamshidi"},
}};

constexpr std::string_view kKopperdahl =
    "D. Kopperdahl, E. Morgan, T. Keaveny, J. Orthop. Res. 20 (2002), human vertebrae";

constexpr std::array<BoneLaw, 4> kLaws{{
    {.name = "kopperdahl-linear",
     .source = kKopperdahl,
     .modulus_MPa = {-34.7, 3230, 1},
     .strength_MPa = DensityLaw{-0.75, 24.9, 1},
     .kind = DensityKind::kQct},
    {.name = "kopperdahl-power",
     .source = kKopperdahl,
     .modulus_MPa = {0, 2980, 1.05},
     .strength_MPa = DensityLaw{0, 37.4, 1.39},
     .kind = DensityKind::kQct},
    {.name = "morgan",
     .source = "E. Morgan, H. Bayraktar, T. Keaveny, J. Biomech. 36 (2003), human vertebrae",
     .modulus_MPa = {0, 4730, 1.56},
     .strength_MPa = std::nullopt,
     .kind = DensityKind::kApparent},
    {.name = "keller",
     .source = "T. Keller, J. Biomech. 27 (1994), human vertebrae",
     .modulus_MPa = {0, 1890, 1.92},
     .strength_MPa = std::nullopt,
     .kind = DensityKind::kAsh},
}};

// Pressure of a core of bone on the bore over the pressure along it; assumed, 0.05 to 0.25.
constexpr double kCorePressureRatio = 0.15;
// A sheet of no thickness holds the shaft as if it were this thick: the figures of its hole are
// those of the whole sheet.
constexpr double kSheetHole_m = 1e-3;
// So strong that nothing of a session breaks it.
constexpr double kUnbreakable_N = 1e9;
// The elastic modulus of the tip's contact is at least that of very sparse trabecular bone.
constexpr double kMinModulus_MPa = 50;
// Strength of bone whose HU show marrow alone: trabeculae are thinner than a voxel, and fat lowers
// the HU. It is that of `kopperdahl-power` at 0.02 g/cm^3.
constexpr double kMinStrength_MPa = 0.16;

// The radius of the disc with the area of the tool's cross-section.
double radius_of(const Tool& tool) {
  double area_m2 = 0;
  for (int i = 0; i < tool.sides; ++i) {
    const Eigen::Vector3d a = tool.corner_plate_m[i] - tool.tip_plate_m,
                          b = tool.corner_plate_m[(i + 1) % tool.sides] - tool.tip_plate_m;
    area_m2 += 0.5 * a.cross(b).dot(tool.axis_plate);
  }
  return std::sqrt(area_m2 / std::numbers::pi);
}

Result<void> set_bone(const Sheet& sheet, const BoneByHu& bone, BoneSheet& out) {
  const std::string where = "slice " + std::to_string(sheet.slice_index) + ": ";
  out.law = find_bone_law(bone.law);
  if (out.law == nullptr) {
    std::string names;
    for (const BoneLaw& law : bone_laws())
      names.append(names.empty() ? "" : ", ").append(law.name);
    return refused(where + "no bone law is called \"" + bone.law + "\"; there are " + names);
  }
  out.calibration.per_HU = bone.per_HU;
  out.calibration.at_0_HU = bone.at_0_HU;
  out.calibration.kind = bone.density == "apparent" ? DensityKind::kApparent
                         : bone.density == "ash"    ? DensityKind::kAsh
                                                    : DensityKind::kQct;
  out.calibration.is_assumed = !bone.calibration_is_given;
  if (!out.law->strength_MPa)
    return refused(where + "the bone law " + bone.law + " has a modulus only, no strength");
  if (out.law->kind != out.calibration.kind)
    return refused(where + "the bone law " + bone.law + " is for " +
                   std::string(name_of(out.law->kind)) + ", the calibration gives " +
                   std::string(name_of(out.calibration.kind)));
  if (!sheet.field->has_hu())
    return refused(where +
                   "its tissue takes the strength from HU, which the asset does not have; " +
                   "give strength_MPa, or mesh it again with --hu");
  return {};
}

// `outline_share`: the length of the tool's outline over that of the disc of its area.
Result<void> set_strength(const Sheet& sheet, const ToolShape& shape, double outline_share,
                          const SceneBody& body, BoneSheet& out) {
  const Tissue& tissue = sheet.tissue;
  out.tip_N_per_m = tissue.stiffness_N_per_m;
  out.states_tool_forces = !tissue.cut;
  out.nominal_N = tissue.threshold_N;
  if (tissue.cut) {
    const CutTissue& cut = *tissue.cut;
    out.pressure_over_yield = cut.pressure_over_yield;
    CutMaterial& material = out.material;
    material.tearing_N_per_m = cut.tearing_N_per_m;
    material.face_friction = cut.friction_coefficient;
    material.modulus_Pa = cut.modulus_MPa * 1e6;
    material.wall_Pa_per_m = cut.foundation_N_per_mm3 * 1e9;
    material.lateral_strength_Pa = cut.lateral_strength_MPa * 1e6;
    material.strength_Pa = cut.pressure_over_yield * cut.strength_MPa.value_or(0) * 1e6;
    if (cut.bone) {
      if (auto ok = set_bone(sheet, *cut.bone, out); !ok) return ok;
      material.strength_Pa = out.pressure_Pa(sheet.field->mean_hu());
      if (!tissue.stiffness_is_given && !(material.modulus_Pa > 0))
        material.modulus_Pa =
            1e6 * std::max(kMinModulus_MPa,
                           value_of(out.law->modulus_MPa,
                                    density_of(out.calibration, sheet.field->mean_hu())));
    }
    material.friction_Pa =
        outline_share * (cut.friction_kPa * 1e3 + cut.friction_coefficient * material.strength_Pa);
    // A flat tip tears along its outline, others along their own edges.
    if (shape.half_angle_rad >= std::numbers::pi / 2) material.tearing_N_per_m *= outline_share;
    const ToolInTissue in = tool_in_tissue(shape, material);
    if (material.friction_Pa > 0)
      out.friction_N_per_m_Pa =
          outline_share * cut.friction_coefficient * in.friction_N_per_m / material.friction_Pa;
    out.nominal_N = in.strength_N;
    if (material.modulus_Pa > 0) out.tip_N_per_m = in.tip_N_per_m;
  }
  out.shell_factor = body.shell_factor;
  out.shell_m = body.shell_m;
  out.shell_free_radius_m = body.shell_free_radius_m;
  if (out.law != nullptr)
    out.cortex_HU = body.cortex_HU.value_or(body.shell_m > 0 ? 0 : kAssumedCortex_HU);
  if (out.shell_free_radius_m > 0 && out.law == nullptr)
    return refused("/body/shell/free_radius_m: slice " + std::to_string(sheet.slice_index) +
                   " has a tissue without a bone law");
  return {};
}

// Contract 3: the bevel of a tool, by the uppermost tissue with CutTissue. Zero without a bevel or
// such a tissue.
Eigen::Vector3d bevel_of(const BoneVolume& bone) {
  const auto decides = std::find_if(
      bone.sheets.begin(), bone.sheets.end(),
      [](const BoneSheet& sheet) { return !sheet.states_tool_forces && sheet.nominal_N > 0; });
  if (decides == bone.sheets.end()) return Eigen::Vector3d::Zero();
  const double ratio = tool_in_tissue(bone.shape, decides->material).lateral_N / decides->nominal_N;
  return std::min(ratio, kMaxSlope) * bone.tool.side_plate;
}

// Sets the values of a hole in a slab of this thickness.
void set_hole(const Tissue& tissue, const BoneSheet& sheet, const ToolShape& shape,
              double thickness_m, CuttingSlab& slab) {
  const bool is_sheet = thickness_m <= 0;
  const double length_m = is_sheet ? kSheetHole_m : thickness_m;
  slab.hole_m = is_sheet ? kSheetHole_m : 0;
  slab.friction_N_per_m = tissue.shaft.dry_friction_N / length_m;
  slab.viscous_N_s_per_m2 = tissue.shaft.viscous_friction_N_s_per_m / length_m;
  if (tissue.shaft.rim_stiffness_N_per_m > 0) {
    slab.wall_N_per_m2 = tissue.shaft.rim_stiffness_N_per_m / length_m;
    slab.wall_strength_N_per_m = kUnbreakable_N;
  }
  CutMaterial material = sheet.material;
  if (sheet.states_tool_forces) {
    if (is_sheet || tissue.shaft.rim_stiffness_N_per_m > 0) return;
    const double area_m2 = std::numbers::pi * shape.outer_radius_m * shape.outer_radius_m;
    material.wall_Pa_per_m = tissue.stiffness_N_per_m / area_m2;
    material.lateral_strength_Pa = tissue.threshold_N / area_m2;
  }
  const ToolInTissue in = tool_in_tissue(shape, material);
  slab.friction_N_per_m += in.friction_N_per_m;
  slab.wall_N_per_m2 += in.wall_N_per_m2;
  slab.wall_strength_N_per_m += in.wall_strength_N_per_m;
}

// Adds the depths below the top of the i-th sheet at which a shell ends that begins at the top of
// this sheet or of one above it, or at the bottom of this sheet or of one below it.
void add_shell_ends(std::span<const BoneSheet> sheets, std::size_t i, double shell_m,
                    std::vector<double>& ends) {
  const auto thickness_of = [&](std::size_t k) { return sheets[k].bottom_m - sheets[k].top_m; };
  const double thickness_m = thickness_of(i);
  const auto add = [&](double at_m) {
    const bool is_new = std::all_of(ends.begin(), ends.end(), [&](double end_m) {
      return std::abs(at_m - end_m) > kMinPart_m;
    });
    if (is_new && at_m > 0 && at_m < thickness_m) ends.push_back(at_m);
  };
  double left_m = shell_m;  // the part of the shell that is left below the sheets above
  for (std::size_t k = i; left_m > 0; --k) {
    add(left_m);
    if (!sheets[k].meets_above) break;
    left_m -= thickness_of(k - 1);
  }
  left_m = shell_m;
  for (std::size_t k = i; left_m > 0; ++k) {
    add(thickness_m - left_m);
    if (!sheets[k].meets_below) break;
    left_m -= thickness_of(k + 1);
  }
}

// Depths at which the slab of the i-th sheet is divided, from its top to its bottom. The sheets'
// extents are known.
std::vector<double> parts_of(std::span<const BoneSheet> sheets, std::size_t i, double shell_m) {
  const double thickness_m = sheets[i].bottom_m - sheets[i].top_m;
  std::vector<double> ends{0, thickness_m};
  if (shell_m > 0 && thickness_m > 0) {
    // These are all ends if the sheets are equally thick.
    const double rest = std::fmod(shell_m, thickness_m);
    for (const double at : {rest, thickness_m - rest})
      ends.push_back(at);
    add_shell_ends(sheets, i, shell_m, ends);
  }
  std::sort(ends.begin(), ends.end());
  std::vector<double> out;
  for (const double end : ends)
    if (out.empty() || end - out.back() > kMinPart_m) out.push_back(end);
  if (out.size() < 2) out = {0, thickness_m};
  out.back() = thickness_m;
  return out;
}

// Contract 1: of the i-th of `depth_m`, which are those of one body.
// `meets_above` and `meets_below` are known.
void set_extent(std::span<const double> depth_m, std::size_t i, double spacing_m, BoneSheet& out) {
  const double above = out.meets_above ? depth_m[i] - depth_m[i - 1] : 0,
               below = out.meets_below ? depth_m[i + 1] - depth_m[i] : 0;
  const double half = spacing_m / 2;
  const double up = out.meets_above ? above / 2 : out.meets_below ? below / 2 : half;
  const double down = out.meets_below ? below / 2 : out.meets_above ? above / 2 : half;
  out.top_m = depth_m[i] - up;
  out.bottom_m = depth_m[i] + down;
}

// The depths of all sheets. A run of sheets is one body.
std::vector<BoneSheet> placed_sheets(const Scene& scene, std::span<const Sheet* const> sheets) {
  std::vector<BoneSheet> placed(sheets.size());
  std::vector<double> depth_m;
  for (const Sheet* sheet : sheets)
    depth_m.push_back(-sheet->z_m);
  for (std::size_t from = 0; from < sheets.size();) {
    std::size_t to = from + 1;
    double spacing_m = 1;
    for (; to < sheets.size(); ++to) {
      const double gap_m = depth_m[to] - depth_m[to - 1];
      if (!scene.body && gap_m > kMaxSlabGap_m + kSlabGapRounding_m) break;
      spacing_m = std::min(spacing_m, gap_m);
    }
    // Slices of a bone volume that are not adjacent in the asset have empty slices between them.
    const auto meets = [&](std::size_t above) {
      return !scene.body ||
             std::abs(sheets[above]->slice_index - sheets[above + 1]->slice_index) == 1;
    };
    const std::span<const double> run(depth_m.data() + from, to - from);
    for (std::size_t i = 0; i < run.size(); ++i) {
      BoneSheet& out = placed[from + i];
      out.top_m = out.bottom_m = run[i];
      out.meets_above = i > 0 && meets(from + i - 1);
      out.meets_below = i + 1 < run.size() && meets(from + i);
      if (run.size() > 1) set_extent(run, i, spacing_m, out);
      if (out.meets_above) out.top_m = placed[from + i - 1].bottom_m;  // to the bit
    }
    from = to;
  }
  return placed;
}

// The options of the law that follow from the scene and its tool. `tissue`: that of the uppermost
// sheet.
CuttingOptions options_of(const Scene& scene, const BoneVolume& bone, const Tissue& tissue) {
  CuttingOptions options;
  options.tool = {bone.tool.tip_plate_m, -bone.tool.axis_plate, bone.radius_m};
  options.presliding_m = tissue.shaft.presliding_m;
  const SceneForceLaw& law = scene.force_law;
  options.tip_friction = law.tip_friction;
  options.tip_hold = law.tip_hold;
  if (law.coupling_N_per_m > 0) options.coupling.translation_N_per_m = law.coupling_N_per_m;
  if (law.coupling_Nm_per_rad > 0) options.coupling.rotation_Nm_per_rad = law.coupling_Nm_per_rad;
  const double bore_m = bone.shape.inner_radius_m;
  if (bore_m > 0) {
    options.core_fraction = bore_m / (bore_m + bone.shape.outer_radius_m);
    if (tissue.cut)
      options.core_growth_per_m =
          2 * tissue.cut->friction_coefficient * kCorePressureRatio / bore_m;
  }
  return options;
}

// A slab's ends exceed its own and its neighbour's strength by at most this fraction of its own.
constexpr double kBeyondNeighbours = 0.05;

// Returns the shape of a scene's tool. Errors: kRefused if the tool's kind does not exist, or if
// the shape is not valid (error_of()).
Result<ToolShape> tool_shape(const SceneTool& tool) {
  ToolShape shape;
  shape.outer_radius_m = radius_of(make_tool(tool));
  shape.inner_radius_m = tool.inner_radius_m;
  shape.half_angle_rad =
      tool.kind.empty() ? std::numbers::pi / 2 : tool.half_angle_deg * std::numbers::pi / 180;
  if (!tool.kind.empty()) {
    const std::optional<ToolKind> kind = find_tool_kind(tool.kind);
    if (!kind) {
      std::string names;
      for (const ToolKind each : {ToolKind::kNeedleBevel, ToolKind::kNeedleConical,
                                  ToolKind::kNeedleDiamond, ToolKind::kTrocar, ToolKind::kJamshidi})
        names.append(names.empty() ? "" : ", ").append(name_of(each));
      return refused("/tool/kind: no tool is called \"" + tool.kind + "\"; there are " + names);
    }
    shape.kind = *kind;
  }
  if (const auto error = error_of(shape)) return refused("/tool: " + std::string(*error));
  return shape;
}

}  // namespace

std::string_view name_of(ToolKind kind) noexcept {
  for (const auto& [each, name] : kNames)
    if (each == kind) return name;
  return "unknown";
}

std::optional<ToolKind> find_tool_kind(std::string_view name) noexcept {
  for (const auto& [kind, each] : kNames)
    if (each == name) return kind;
  return std::nullopt;
}

std::optional<std::string_view> error_of(const ToolShape& tool) noexcept {
  if (!(tool.outer_radius_m > 0) || !std::isfinite(tool.outer_radius_m))
    return "the tool's outer radius must be above 0";
  if (!(tool.inner_radius_m >= 0 && tool.inner_radius_m < tool.outer_radius_m))
    return "the tool's inner radius must be at least 0 and less than the outer";
  if ((tool.kind == ToolKind::kJamshidi) != (tool.inner_radius_m > 0))
    return "a jamshidi is hollow (inner radius above 0), other tools are not";
  // Below 3 degrees the tip is a needle's length of its own.
  if (!(tool.half_angle_rad >= kPi / 60 - 1e-9 && tool.half_angle_rad <= kPi / 2 + 1e-9))
    return "the tip's half angle must be within 3 and 90 degrees";
  if (tool.kind == ToolKind::kJamshidi && tool.half_angle_rad < kPi / 2 - 1e-9)
    return "a jamshidi's edge is flat, so its half angle must be 90 degrees";
  return std::nullopt;
}

double slice_push(const ToolShape& tool, double twist_rad_per_s, double feed_m_per_s) noexcept {
  const double across = std::abs(twist_rad_per_s) * tool.outer_radius_m;
  if (!(across > 0)) return 0;
  const double along = std::max(feed_m_per_s, 0.0);
  return across >= kMaxSlicePush * along ? kMaxSlicePush : across / along;
}
double displaced_area_m2(const ToolShape& tool) noexcept {
  return kPi *
         (tool.outer_radius_m * tool.outer_radius_m - tool.inner_radius_m * tool.inner_radius_m);
}

double torn_length_m(const ToolShape& tool) noexcept {
  if (is_flat(tool)) return 2 * kPi * (tool.outer_radius_m + tool.inner_radius_m);
  if (tool.kind == ToolKind::kNeedleDiamond) return 4 * tool.outer_radius_m;
  if (tool.kind == ToolKind::kTrocar) return 3 * tool.outer_radius_m;
  return 2 * tool.outer_radius_m;
}

ToolInTissue tool_in_tissue(const ToolShape& tool, const CutMaterial& tissue, double share,
                            double slice_push) noexcept {
  const double R = tool.outer_radius_m, around = 2 * kPi * (R + tool.inner_radius_m);
  const double xi2 = slice_push * slice_push;
  const double faces =
      is_flat(tool) ? 0 : tissue.face_friction / std::tan(tool.half_angle_rad) / std::sqrt(1 + xi2);
  const double tearing = share * tissue.tearing_N_per_m * torn_length_m(tool) / (1 + xi2);
  ToolInTissue out;
  const double r = tool.inner_radius_m, lever_m = 2 * (R * R + R * r + r * r) / (3 * (R + r));
  const double pressed_N = share * tissue.strength_Pa * displaced_area_m2(tool);
  out.strength_N = pressed_N * (1 + faces) + tearing;
  out.torsion_Nm = slice_push * tearing * R + tissue.face_friction * pressed_N /
                                                  std::sin(tool.half_angle_rad) * lever_m *
                                                  slice_push / std::sqrt(1 + xi2);
  if (tool.kind == ToolKind::kNeedleBevel && !is_flat(tool))
    out.lateral_N =
        pressed_N * std::max(1 / std::tan(tool.half_angle_rad) - tissue.face_friction, 0.0);
  out.tip_N_per_m = 2 * R * tissue.modulus_Pa / (1 - tissue.poisson * tissue.poisson);
  out.friction_N_per_m = tissue.friction_Pa * around;
  out.wall_N_per_m2 = tissue.wall_Pa_per_m * 2 * R;
  out.wall_strength_N_per_m = tissue.lateral_strength_Pa * 2 * R;
  return out;
}

std::string_view name_of(DensityKind kind) noexcept {
  constexpr std::string_view kDensities[] = {"QCT mineral density", "ash density",
                                             "apparent density"};
  return kDensities[static_cast<std::size_t>(kind)];
}
std::span<const BoneLaw> bone_laws() noexcept {
  return kLaws;
}

const BoneLaw* find_bone_law(std::string_view name) noexcept {
  const auto at = std::find_if(kLaws.begin(), kLaws.end(),
                               [&](const BoneLaw& law) { return law.name == name; });
  return at == kLaws.end() ? nullptr : &*at;
}

double value_of(const DensityLaw& law, double density) noexcept {
  if (!(density > 0)) return std::max(law.constant, 0.0);
  return std::max(law.constant + law.factor * std::pow(density, law.exponent), 0.0);
}

double BoneSheet::pressure_Pa(double hu) const noexcept {
  return pressure_over_yield * 1e6 *
         std::max(kMinStrength_MPa, value_of(*law->strength_MPa, density_of(calibration, hu)));
}

double BoneSheet::friction_N_per_m(double hu, double nominal_N_per_m) const noexcept {
  if (law == nullptr) return nominal_N_per_m;
  return nominal_N_per_m + friction_N_per_m_Pa * (pressure_Pa(hu) - material.strength_Pa);
}

double BoneSheet::shell_N(const ToolShape& shape, double hu, double strength_N) const noexcept {
  const double supported_N = shell_factor * strength_N;
  if (law == nullptr || !(shell_free_radius_m > 0)) return supported_N;
  // QCT density is about the ash density.
  const double apparent = 1 / kAshOverApparent * density_of(calibration, hu);
  const ThinWall wall{.thickness_m = shell_m,
                      .free_radius_m = shell_free_radius_m,
                      .flow_Pa = cortex_flow_Pa(apparent)};
  return std::min(supported_N, break_N(wall, shape.outer_radius_m));
}

CutMaterial BoneSheet::material_at(double hu) const noexcept {
  CutMaterial here = material;
  if (law != nullptr) here.strength_Pa = pressure_Pa(hu);
  return here;
}

double BoneSheet::strength_N(const ToolShape& shape, double hu, double slice_push) const noexcept {
  if (states_tool_forces || (law == nullptr && slice_push == 0)) return nominal_N;
  return tool_in_tissue(shape, material_at(hu), 1, slice_push).strength_N;
}

double BoneSheet::torsion_Nm(const ToolShape& shape, double hu, double slice_push) const noexcept {
  return states_tool_forces ? 0 : tool_in_tissue(shape, material_at(hu), 1, slice_push).torsion_Nm;
}
Result<void> resolve_layers(Scene& scene) {
  const Result<ToolShape> shape = tool_shape(scene.tool);
  if (!shape) return shape.error();
  for (SceneLayer& layer : scene.layers) {
    if (!(layer.toughness_J_per_m2 > 0)) continue;
    layer.puncture_N = membrane_break_N(layer.toughness_J_per_m2, layer.thickness_m, *shape);
    layer.cutting_N = layer.cutting_is_given ? std::min(layer.cutting_N, layer.puncture_N)
                                             : kTearingFraction * layer.puncture_N;
  }
  return {};
}

Result<BoneVolume> make_bone_volume(const Scene& scene, std::span<const Sheet* const> sheets) {
  BoneVolume bone;
  bone.tool = make_tool(scene.tool);
  bone.radius_m = radius_of(bone.tool);
  if (const auto ok = tool_shape(scene.tool).into(bone.shape); !ok) return ok.error();
  double outline_m = 0;
  for (int i = 0; i < bone.tool.sides; ++i)
    outline_m +=
        (bone.tool.corner_plate_m[(i + 1) % bone.tool.sides] - bone.tool.corner_plate_m[i]).norm();
  const double outline_share = outline_m / (2 * std::numbers::pi * bone.radius_m);
  bone.twists = scene.force_law.twist;
  const SceneBody body = scene.body.value_or(SceneBody{.cortex_HU = 0});
  bone.shell_m = body.shell_m;

  bone.options = options_of(scene, bone, sheets.front()->tissue);
  const CuttingOptions& options = bone.options;

  bone.sheets = placed_sheets(scene, sheets);
  double embedded_m = 0, friction_N = 0;
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    BoneSheet& out = bone.sheets[i];
    if (auto ok = set_strength(*sheets[i], bone.shape, outline_share, body, out); !ok)
      return ok.error();
    out.first_slab = static_cast<int>(bone.slabs.size());
    const std::vector<double> ends = parts_of(bone.sheets, i, bone.shell_m);
    for (std::size_t k = 0; k + 1 < ends.size(); ++k) {
      CuttingSlab slab;
      slab.top_m = out.top_m + ends[k];
      slab.bottom_m = k + 2 == ends.size() ? out.bottom_m : out.top_m + ends[k + 1];
      slab.strength_top_N = slab.strength_bottom_N = out.nominal_N;
      set_hole(sheets[i]->tissue, out, bone.shape, out.bottom_m - out.top_m, slab);
      const double length_m = slab.bottom_m - slab.top_m + slab.hole_m;
      bone.across_N_per_m += slab.wall_N_per_m2 * length_m;
      bone.viscous_N_s_per_m += slab.viscous_N_s_per_m2 * length_m;
      embedded_m += length_m;
      friction_N += slab.friction_N_per_m * length_m;
      bone.slabs.push_back(slab);
      bone.sheet_of_slab.push_back(static_cast<int>(i));
    }
    out.slabs = static_cast<int>(bone.slabs.size()) - out.first_slab;
  }
  bone.options.tool.bevel_plate = bevel_of(bone);
  bone.along_N_per_m +=
      friction_N * core_friction_factor(options, embedded_m) / std::max(options.presliding_m, 1e-9);
  double tip_N_per_m = 0, strongest_N = 0;
  for (const BoneSheet& sheet : bone.sheets) {
    tip_N_per_m = std::max(tip_N_per_m, sheet.tip_N_per_m);
    strongest_N = std::max(strongest_N, sheet.nominal_N);
  }
  bone.options.tip_N_per_m = bone.sheets.front().tip_N_per_m;
  bone.along_N_per_m += tip_N_per_m;
  bone.yielding_N_per_m = (options.tip_hold + options.tip_friction) * strongest_N /
                          std::max(options.tip_presliding_m, 1e-9);
  for (const SceneLayer& layer : scene.layers) {
    if (layer.toughness_J_per_m2 > 0 && !(layer.puncture_N > 0))
      return refused("/layers: the force of \"" + layer.name +
                     "\" was not computed from its toughness");
    SoftLayer soft;
    soft.top_m = -layer.top_z_m;
    soft.bottom_m = soft.top_m + layer.thickness_m;
    soft.stiffness_N_per_m = layer.stiffness_N_per_m;
    soft.stiffening_N_per_m2 = layer.stiffening_N_per_m2;
    soft.puncture_N = layer.puncture_N;
    soft.cutting_N = layer.cutting_N;
    soft.friction_N_per_m = layer.friction_N_per_m;
    bone.layers.push_back(soft);
    // At its puncture it is as stiff as it gets.
    bone.along_N_per_m += soft_spring(soft, stretch_at(soft, soft.puncture_N)).stiffness_N_per_m;
    bone.yielding_N_per_m +=
        soft.friction_N_per_m * layer.thickness_m / std::max(options.presliding_m, 1e-9);
  }
  return bone;
}

std::array<double, 2> strength_ends(double strength_N, double above_N, double above_gap_m,
                                    double below_N, double below_gap_m,
                                    double thickness_m) noexcept {
  if (!(above_gap_m > 0 && below_gap_m > 0)) return {strength_N, strength_N};
  // A slab's mean is its slice's also where the slice is not in its middle.
  const double line_N = (below_N - above_N) / (above_gap_m + below_gap_m) * thickness_m / 2,
               beyond_N = kBeyondNeighbours * strength_N;
  const auto limited = [&](double end_N, double neighbour_N) {
    return std::clamp(end_N, std::max(0.0, std::min(strength_N, neighbour_N) - beyond_N),
                      std::max(strength_N, neighbour_N) + beyond_N) -
           strength_N;
  };
  const double down_N = limited(strength_N + line_N, below_N),
               up_N = -limited(strength_N - line_N, above_N);
  const double change_N = std::abs(down_N) < std::abs(up_N) ? down_N : up_N;
  return {strength_N - change_N, strength_N + change_N};
}

double wall_thickness_m(double slab_HU, double inside_HU, double cortex_HU,
                        double slab_thickness_m) noexcept {
  if (!(slab_HU - inside_HU >= kMinContrast_HU)) return 0;
  const double wall_m =
      slab_thickness_m * (slab_HU - inside_HU) / (std::max(cortex_HU, slab_HU) - inside_HU);
  return wall_m >= kMinWall_m ? wall_m : 0;
}

double membrane_break_N(double toughness_J_per_m2, double thickness_m,
                        const ToolShape& tool) noexcept {
  double crack_m = torn_length_m(tool);
  if (!is_flat(tool)) crack_m = std::min(crack_m, 2 * thickness_m * std::tan(tool.half_angle_rad));
  return toughness_J_per_m2 * crack_m / kTearingFraction;
}

using std::numbers::pi;

double cortex_flow_Pa(double apparent_g_per_cm3) noexcept {
  const double relative = apparent_g_per_cm3 / 1.9;
  return 100e6 * relative * relative;
}

double bending_N(const ThinWall& wall, double tip_radius_m) noexcept {
  const double a = std::min(tip_radius_m, wall.free_radius_m);
  const double moment_N = wall.flow_Pa * wall.thickness_m * wall.thickness_m / 4;
  return wall.clamping * pi * moment_N / (1 - 2 * a / (3 * wall.free_radius_m));
}

double punching_N(const ThinWall& wall, double tip_radius_m) noexcept {
  return 2 * pi * tip_radius_m * wall.thickness_m * wall.shear_Pa;
}

double break_N(const ThinWall& wall, double tip_radius_m) noexcept {
  return std::min(bending_N(wall, tip_radius_m), punching_N(wall, tip_radius_m));
}

}  // namespace trocar::runtime
