// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/procedures.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "runtime/bone_cutting/law/cutting_law.h"
#include "runtime/bone_cutting/material/bone_strength.h"

namespace trocar::test {
namespace {

using namespace trocar::runtime;

ToolShape shape(ToolKind kind, double outer_mm, double inner_mm, double half_angle_deg) {
  ToolShape s;
  s.kind = kind;
  s.outer_radius_m = outer_mm * 0.5e-3;
  s.inner_radius_m = inner_mm * 0.5e-3;
  s.half_angle_rad = half_angle_deg / 180 * 3.14159265358979;
  return s;
}

SoftLayer layer(double top_m, double thickness_m, double a1, double a2, double puncture_N,
                double cutting_N) {
  return {.top_m = top_m,
          .bottom_m = top_m + thickness_m,
          .stiffness_N_per_m = a1,
          .stiffening_N_per_m2 = a2,
          .puncture_N = puncture_N,
          .cutting_N = cutting_N};
}

CutMaterial tissue_of(const Procedure& p, const BoneConstants& constants) {
  CutMaterial t;
  t.modulus_Pa = 1e8;
  if (p.density_g_per_cm3 > 0) {
    const BoneLaw& law = *find_bone_law("kopperdahl-linear");
    t.strength_Pa =
        constants.pressure_over_yield * 1e6 * value_of(*law.strength_MPa, p.density_g_per_cm3);
    t.modulus_Pa = 1e6 * value_of(law.modulus_MPa, p.density_g_per_cm3);
    t.face_friction = constants.friction;
    // The material that the tool has displaced presses on its wall as on its tip.
    t.friction_Pa = constants.friction * t.strength_Pa;
    t.presliding_Pa_per_m = t.friction_Pa / 1e-4;
  } else {
    t.strength_Pa = p.strength_Pa;
  }
  return t;
}

struct Push {
  double peak_N = 0, cut_J = 0, work_J = 0;
};

Push push(const CuttingOptions& options, const std::vector<CuttingSlab>& slabs, double to_m) {
  CuttingState state = make_cutting_state(slabs.size(), 1, options.layers.size());
  CuttingResult out;
  Push push;
  constexpr double kStep_m = 1e-5;
  double before_N = 0;
  for (int k = -10; k * kStep_m <= to_m; ++k) {
    Pose X;
    X.p_m.z() = -k * kStep_m;
    cutting_tick(options, X, slabs, state, out);
    const double force_N = out.wrench_device[2];
    push.peak_N = std::max(push.peak_N, force_N);
    push.cut_J += out.cut_J;
    push.work_J += 0.5 * (before_N + force_N) * kStep_m;
    before_N = force_N;
  }
  return push;
}

}  // namespace

std::vector<Procedure> procedures() {
  std::vector<Procedure> rows;

  Procedure probe;
  probe.name = "pedicle probe, cannulation";
  probe.standing = Standing::kFitted;
  probe.tool = "cone of 3.5 mm, half angle 15 deg, thinner behind the tip (assumed)";
  probe.tissue = "0.20 g/cm^3 QCT (assumed)";
  probe.shape = shape(ToolKind::kNeedleConical, 3.5, 0, 15);
  probe.density_g_per_cm3 = 0.20;
  probe.published_low = probe.published_high = 90;
  probe.conditions =
      "mean of 42 thoracolumbar pedicles of 8 cadavers, 3 surgeons, awl with a load cell";
  probe.source = "CORS 2013-220, Orthop. Proc. 96-B Suppl. 11 (2014)";
  rows.push_back(probe);

  Procedure breach = probe;
  breach.name = "pedicle probe, breach of the cortex";
  breach.standing = Standing::kPredicted;
  breach.tissue = "0.60 g/cm^3 QCT (assumed), the law of cancellous bone beyond its range";
  breach.density_g_per_cm3 = 0.60;
  breach.published_low = 135;
  breach.published_high = 155;
  breach.conditions = "the same pedicles, deliberate breach";
  rows.push_back(breach);

  Procedure jamshidi;
  jamshidi.name = "Jamshidi 8 G, trabecular bone";
  jamshidi.standing = Standing::kFitted;
  jamshidi.tool = "4.0 mm, bore 3.2 mm (assumed), 25 mm deep";
  jamshidi.tissue = "0.30 g/cm^3 QCT (assumed for healthy bone)";
  jamshidi.shape = shape(ToolKind::kJamshidi, 4.0, 3.2, 90);
  jamshidi.density_g_per_cm3 = 0.30;
  jamshidi.rubbing_m = 0.025;
  jamshidi.published_low = jamshidi.published_high = 1000;
  jamshidi.conditions = "largest force, at 25 mm and 1 mm/s, without twist";
  jamshidi.source = "R. Mulligan et al., Mater. Sci. Forum 654-656 (2010)";
  rows.push_back(jamshidi);

  Procedure friction = jamshidi;
  friction.name = "Jamshidi, friction's share of the work";
  friction.standing = Standing::kPredicted;
  friction.is_share_of_work = true;
  friction.published_low = 0.5;
  friction.published_high = 1;
  friction.conditions = "bone analogue, push and twist; \"much more\" by friction than by cutting";
  friction.source = "A. Heiner et al., J. Biomech. Eng. 123 (2001)";
  rows.push_back(friction);

  Procedure vertebral;
  vertebral.name = "Jamshidi 11 G with its stylet, vertebral body";
  vertebral.tool = "3.05 mm, three faces of 25 deg (assumed), 30 mm deep (assumed)";
  vertebral.tissue = "0.12 g/cm^3 QCT (assumed: 150 HU)";
  vertebral.shape = shape(ToolKind::kTrocar, 3.048, 0, 25);
  vertebral.density_g_per_cm3 = 0.12;
  vertebral.rubbing_m = 0.03;
  vertebral.published_low = 400;
  vertebral.published_high = 1000;
  vertebral.conditions = "range by hand, with the cortex; no measurement of this needle was found";
  vertebral.source = "range without a source";
  rows.push_back(vertebral);

  Procedure trephine;
  trephine.name = "trephine needle, biopsy by hand";
  trephine.tool = "4.19 mm (8 G), bore 3.2 mm, 20 mm deep (assumed), without twist";
  trephine.tissue = "0.15 g/cm^3 QCT (assumed for the iliac crest)";
  trephine.shape = shape(ToolKind::kJamshidi, 4.191, 3.2, 90);
  trephine.density_g_per_cm3 = 0.15;
  trephine.rubbing_m = 0.02;
  trephine.published_low = 400;
  trephine.published_high = 600;
  trephine.conditions = "forward force of the clinician, \"up to\", by bone, with twist";
  trephine.source = "IEEE Xplore document 8579919, introduction";
  rows.push_back(trephine);

  Procedure ligament;
  ligament.name = "lumbar puncture, ligamentum flavum";
  ligament.standing = Standing::kGiven;
  ligament.tool = "17 G";
  ligament.tissue = "500 N/m, 212 kN/m^2 (assumed), 4 mm";
  ligament.shape = shape(ToolKind::kNeedleBevel, 1.473, 0, 30);
  ligament.layers = {layer(0, 0.004, 500, 2.12e5, 11.45, 2)};
  ligament.published_low = 11.1;
  ligament.published_high = 11.8;
  ligament.conditions = "porcine lumbar spine, 17 insertions, force on a Tuohy needle's plunger";
  ligament.source = "N. Vaughan et al., conference paper, Bournemouth (2012)";
  rows.push_back(ligament);

  Procedure dura = ligament;
  dura.name = "lumbar puncture, dura";
  dura.tissue = "150 N/m, 10 kN/m^2 (assumed), 0.4 mm";
  dura.layers = {layer(0, 4e-4, 150, 1e4, 0.6, 0.1)};
  dura.published_low = 0.2;
  dura.published_high = 1;
  dura.conditions =
      "17 G Tuohy through cadaveric dura; the range is quoted, the paper's values were not seen";
  dura.source = "M. Lewis et al., Br. J. Anaesth. 85 (2000)";
  rows.push_back(dura);

  Procedure by_strength = dura;
  by_strength.name = "dura, from its tensile strength";
  by_strength.standing = Standing::kPredicted;
  by_strength.layers.clear();
  by_strength.shape.half_angle_rad = 3.14159265358979 / 2;
  by_strength.tissue =
      "8.35 MPa tensile, cranial (B. Aydin et al. 2019), taken as pressure on the tip";
  by_strength.strength_Pa = 8.35e6;
  rows.push_back(by_strength);
  return rows;
}

double predict(const Procedure& p, const BoneConstants& constants) {
  CuttingOptions options;
  options.coupling.is_rigid = true;
  options.layers = p.layers;
  if (!p.layers.empty()) return push(options, {}, 0.02).peak_N;
  const CutMaterial tissue = tissue_of(p, constants);
  const ToolInTissue in = tool_in_tissue(p.shape, tissue, 1, p.slice_push);
  options.tip_N_per_m = in.tip_N_per_m;
  options.tool.radius_m = p.shape.outer_radius_m;
  const bool rubs = p.rubbing_m > 0;
  const double depth_m = rubs ? p.rubbing_m : 0.005;
  std::vector<CuttingSlab> slabs(40);
  for (std::size_t i = 0; i < slabs.size(); ++i) {
    slabs[i].top_m = static_cast<double>(i) * 1e-3;
    slabs[i].bottom_m = slabs[i].top_m + 1e-3;
    slabs[i].strength_top_N = slabs[i].strength_bottom_N = in.strength_N;
    if (rubs) slabs[i].friction_N_per_m = in.friction_N_per_m;
  }
  // The front is that far ahead of the tip as the tip is soft.
  const Push done = push(options, slabs, depth_m + in.strength_N / in.tip_N_per_m);
  return p.is_share_of_work ? 1 - done.cut_J / done.work_J : done.peak_N;
}

BoneConstants fit(std::span<const Procedure> rows) {
  const Procedure *rubbing = nullptr, *tip = nullptr;
  for (const Procedure& row : rows) {
    if (row.standing != Standing::kFitted) continue;
    const Procedure*& at = row.rubbing_m > 0 ? rubbing : tip;
    if (at != nullptr) throw std::invalid_argument("two fitted rows of one kind");
    at = &row;
  }
  if (rubbing == nullptr || tip == nullptr)
    throw std::invalid_argument("the fit needs a row with a shaft that rubs and one without");
  // All forces are in proportion to the pressure; the ratio of the two rows gives the friction.
  const double wanted = rubbing->published_low / tip->published_low;
  double low = 1e-3, high = 1;
  for (int k = 0; k < 40; ++k) {
    const double middle = 0.5 * (low + high);
    const BoneConstants at{1, middle};
    (predict(*rubbing, at) / predict(*tip, at) < wanted ? low : high) = middle;
  }
  BoneConstants constants{1, 0.5 * (low + high)};
  constants.pressure_over_yield = tip->published_low / predict(*tip, constants);
  return constants;
}

bool is_hit(const Procedure& p, double predicted) {
  const double slack = p.published_low == p.published_high ? 0.2 * p.published_low : 0;
  return predicted >= p.published_low - slack && predicted <= p.published_high + slack;
}

}  // namespace trocar::test
