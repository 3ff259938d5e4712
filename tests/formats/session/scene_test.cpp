// SPDX-License-Identifier: Apache-2.0
#include "formats/session/scene.h"

#include <gtest/gtest.h>

#include <concepts>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace trocar {
namespace {

using nlohmann::json;

json smallest() {
  return json::parse(R"({"schema": "trocar.scene/1", "name": "n", "asset": "a.glb",
    "duration_s": 2, "slices": [{"index": 3, "z_m": 0.12}],
    "hand": {"trajectory": [{"t_s": 0, "tip_m": [0, 0, 0.15]}]}})");
}

json fullest() {
  json scene = smallest();
  scene["device"] = "../d.json";
  scene["rate_Hz"] = 500;
  scene["placement"] = {{"anchor_mm", {80, 72.5}}, {"at_m", {0.001, -0.002}}, {"rotation_deg", 30}};
  scene["slices"].push_back({{"index", 3}, {"z_m", 0.19}});
  scene["tissue"] = {{"stiffness_N_per_m", 4000}, {"threshold_N", 20}, {"damping_N_s_per_m", 1.5}};
  scene["tissue"]["shaft"] = {{"dry_friction_N", 1},
                              {"viscous_friction_N_s_per_m", 2},
                              {"presliding_m", 1e-3},
                              {"rim_stiffness_N_per_m", 3}};
  scene["tissues"] = {{{"name", "cortical"}, {"labels", {22, 23}}, {"threshold_N", 30}},
                      {{"name", "cancellous"}, {"hu", {150, 400}}}};
  scene["slices"][1]["tissue"] = "cancellous";
  scene["force_law"] = {
      {"kind", "network"}, {"solver", "local"}, {"reach_m", 0.02}, {"radius_m", 0.05}};
  scene["tool"] = {
      {"sides", 8}, {"radius_m", 0.002}, {"rotation_deg", 15}, {"tip_in_plate_m", {0, 0, 0.03}}};
  scene["tool"]["tilt_deg"] = 40;
  scene["tool"]["tilt_azimuth_deg"] = -90;
  scene["hand"]["stiffness_N_per_m"] = 3000;
  scene["hand"]["damping_N_s_per_m"] = 90;
  scene["hand"]["rotation_stiffness_Nm_per_rad"] = 10;
  scene["hand"]["rotation_damping_Nm_s_per_rad"] = 0.2;
  scene["hand"]["grip"] = "light";
  scene["hand"]["mass_kg"] = 0.25;
  scene["hand"]["let_go_t_s"] = 1.5;
  scene["hand"]["trajectory"].push_back(
      {{"t_s", 1.5}, {"tip_m", {0, 0, 0.1}}, {"rotation_deg", {1, 2, 3}}});
  return scene;
}

Result<Scene> parse(const json& scene) {
  return parse_scene(scene.dump(), "s.json", "/data");
}

TEST(Scene, ALiveHandHasAStartOnly) {
  json scene = smallest();
  EXPECT_FALSE(parse(scene)->hand.live);
  scene["hand"]["live"] = true;
  const auto live = parse(scene);
  ASSERT_TRUE(live) << live.error().message;
  EXPECT_TRUE(live->hand.live);
  scene["hand"]["let_go_t_s"] = 1;
  EXPECT_NE(parse(scene).error().message.find("/hand/let_go_t_s"), std::string::npos);
  scene["hand"].erase("let_go_t_s");
  scene["hand"]["trajectory"].push_back({{"t_s", 1.5}, {"tip_m", {0, 0, 0.1}}});
  EXPECT_NE(parse(scene).error().message.find("/hand/trajectory"), std::string::npos);
  scene["hand"]["live"] = false;
  EXPECT_TRUE(parse(scene));
}

TEST(Scene, DefaultsAreThoseOfThePaper) {
  const auto scene = parse(smallest());
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ(scene->tissue.stiffness_N_per_m, 5000);
  EXPECT_EQ(scene->tissue.threshold_N, 35);
  EXPECT_EQ(scene->tissue.damping_N_s_per_m, 0);
  EXPECT_EQ(scene->tool.sides, 6);
  EXPECT_EQ(scene->tool.radius_m, 0.003);
  EXPECT_FALSE(scene->placement.anchor_mm);
  EXPECT_FALSE(scene->rate_Hz);
  EXPECT_FALSE(scene->device);
  EXPECT_EQ(scene->asset, "/data/a.glb");
}

TEST(Scene, EveryFieldIsRead) {
  const auto scene = parse(fullest());
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ(scene->name, "n");
  EXPECT_EQ(*scene->device, "/data/../d.json");
  EXPECT_EQ(scene->duration_s, 2);
  EXPECT_EQ(*scene->rate_Hz, 500);
  EXPECT_EQ((*scene->placement.anchor_mm)[1], 72.5);
  EXPECT_EQ(scene->placement.at_m[1], -0.002);
  EXPECT_EQ(scene->placement.rotation_deg, 30);
  ASSERT_EQ(scene->slices.size(), 2U);
  EXPECT_EQ(scene->slices[0].index, 3);
  EXPECT_EQ(scene->slices[1].z_m, 0.19);
  EXPECT_EQ(scene->tissue.stiffness_N_per_m, 4000);
  EXPECT_EQ(scene->tissue.threshold_N, 20);
  EXPECT_EQ(scene->tissue.damping_N_s_per_m, 1.5);
  EXPECT_EQ(scene->tissue.shaft, (ShaftTissue{1, 2, 1e-3, 3}));
  ASSERT_EQ(scene->tissues.size(), 2U);
  EXPECT_EQ(scene->tissues[0].name, "cortical");
  EXPECT_EQ(scene->tissues[0].labels, (std::vector<int>{22, 23}));
  EXPECT_EQ(scene->tissues[0].tissue.threshold_N, 30);
  EXPECT_EQ(scene->tissues[0].tissue.stiffness_N_per_m, 5000) << "not given: the paper's";
  EXPECT_EQ(*scene->tissues[1].hu, (std::array<double, 2>{150, 400}));
  EXPECT_EQ(*scene->slices[1].tissue, "cancellous");
  EXPECT_FALSE(scene->slices[0].tissue);
  EXPECT_EQ(scene->force_law.kind, ForceLawKind::kNetwork);
  EXPECT_EQ(scene->force_law.solver, NetworkSolver::kLocal);
  EXPECT_EQ(scene->force_law.decay_length_m, 0.02);
  EXPECT_EQ(scene->force_law.radius_m, 0.05);
  EXPECT_EQ(scene->tool.tilt_deg, 40);
  EXPECT_EQ(scene->tool.tilt_azimuth_deg, -90);
  EXPECT_EQ(scene->hand.trajectory[1].rotation_deg[2], 3);
  EXPECT_EQ(scene->tool.sides, 8);
  EXPECT_EQ(scene->tool.radius_m, 0.002);
  EXPECT_EQ(scene->tool.rotation_deg, 15);
  EXPECT_EQ(scene->tool.tip_in_plate_m[2], 0.03);
  EXPECT_EQ(*scene->hand.stiffness_N_per_m, 3000);
  EXPECT_EQ(*scene->hand.damping_N_s_per_m, 90);
  EXPECT_EQ(*scene->hand.rotation_stiffness_Nm_per_rad, 10);
  EXPECT_EQ(scene->hand.grip, HandGrip::kLight);
  EXPECT_EQ(*scene->hand.mass_kg, 0.25);
  EXPECT_EQ(*scene->hand.let_go_t_s, 1.5);
  EXPECT_EQ(*scene->hand.rotation_damping_Nm_s_per_rad, 0.2);
  ASSERT_EQ(scene->hand.trajectory.size(), 2U);
  EXPECT_EQ(scene->hand.trajectory[1].t_s, 1.5);
  EXPECT_EQ(scene->hand.trajectory[1].tip_m[2], 0.1);
}

/// A scene with everything that the force law `cutting` can have: bone volume, cut tissues, the law.
json fullest_of_cutting() {
  json scene = smallest();
  scene.erase("slices");
  scene["body"] = {{"from", 3}, {"to", 37}, {"top_z_m", 0.13}};
  scene["body"]["shell"] = {{"thickness_m", 0.0015}, {"strength_factor", 2.5}};
  scene["tissue"]["cut"] = {{"strength_MPa", 4.5},
                            {"tearing_N_per_m", 500},
                            {"friction_kPa", 20},
                            {"bed_N_per_mm3", 12},
                            {"lateral_strength_MPa", 6}};
  scene["tissues"] = {{{"name", "bone"}, {"hu", {100, 2000}}}};
  scene["tissues"][0]["cut"]["bone"] = {{"law", "kopperdahl-linear"},
                                        {"density", "apparent"},
                                        {"g_per_cm3_per_HU", 0.001},
                                        {"g_per_cm3_at_0_HU", -0.02}};
  scene["force_law"] = {{"kind", "cutting"},        {"axis", "coupled"},
                        {"coupling_N_per_m", 8000}, {"coupling_Nm_per_rad", 30},
                        {"prediction", "off"},      {"force_scale", 0.25}};
  return scene;
}

TEST(Scene, EveryFieldOfTheCuttingLawIsRead) {
  const auto scene = parse(fullest_of_cutting());
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_TRUE(scene->slices.empty());
  ASSERT_TRUE(scene->body);
  EXPECT_EQ(scene->body->from, 3);
  EXPECT_EQ(scene->body->to, 37);
  EXPECT_EQ(scene->body->top_z_m, 0.13);
  EXPECT_EQ(scene->body->shell_m, 0.0015);
  EXPECT_EQ(scene->body->shell_factor, 2.5);
  ASSERT_TRUE(scene->tissue.cut);
  EXPECT_EQ(*scene->tissue.cut, (CutTissue{4.5, std::nullopt, 500, 1, 0, 0, 20, 12, 6}));
  ASSERT_EQ(scene->tissues.size(), 1U);
  ASSERT_TRUE(scene->tissues[0].tissue.cut);
  const CutTissue& cut = *scene->tissues[0].tissue.cut;
  EXPECT_FALSE(cut.strength_MPa);
  ASSERT_TRUE(cut.bone);
  EXPECT_EQ(*cut.bone, (BoneByHu{"kopperdahl-linear", "apparent", 0.001, -0.02, true}));
  const SceneForceLaw& law = scene->force_law;
  EXPECT_EQ(law.kind, ForceLawKind::kCutting);
  EXPECT_EQ(law.axis, ToolAxis::kCoupled);
  EXPECT_EQ(law.coupling_N_per_m, 8000);
  EXPECT_EQ(law.coupling_Nm_per_rad, 30);
  EXPECT_EQ(law.prediction, PosePrediction::kOff);
  EXPECT_EQ(law.force_scale, 0.25);
}

TEST(Scene, TheCuttingLawHasItsDefaults) {
  json scene = smallest();
  EXPECT_FALSE(parse(scene)->body);
  EXPECT_FALSE(parse(scene)->tissue.cut);
  scene["force_law"] = {{"kind", "cutting"}};
  scene["tissue"]["cut"]["bone"] = {{"law", "kopperdahl-power"}};
  auto read = parse(scene);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->force_law.axis, ToolAxis::kAuto);
  EXPECT_EQ(read->force_law.coupling_N_per_m, 0) << "as stiff as the device holds";
  EXPECT_EQ(read->force_law.coupling_Nm_per_rad, 0);
  EXPECT_EQ(read->force_law.tip_hold, 0.25);
  EXPECT_EQ(read->force_law.prediction, PosePrediction::kAuto);
  EXPECT_EQ(read->force_law.force_scale, 1);
  const CutTissue& cut = *read->tissue.cut;
  EXPECT_EQ(*cut.bone, (BoneByHu{"kopperdahl-power", "qct", 8e-4, 0, false}))
      << "a calibration that is not given is said to be assumed";
  EXPECT_EQ(cut.tearing_N_per_m, 0);
  EXPECT_EQ(cut.friction_kPa, 0);
  EXPECT_EQ(cut.foundation_N_per_mm3, 0);
  EXPECT_EQ(cut.lateral_strength_MPa, 0);
  for (const char* one : {"g_per_cm3_per_HU", "g_per_cm3_at_0_HU"}) {
    json given = scene;
    given["tissue"]["cut"]["bone"][one] = 0.001;
    EXPECT_TRUE(parse(given)->tissue.cut->bone->calibration_is_given) << one;
  }
  scene.erase("slices");
  scene["body"] = {{"from", 7}, {"to", 7}, {"top_z_m", -0.1}};
  read = parse(scene);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->body->shell_m, 0);
  EXPECT_EQ(read->body->shell_factor, 1);
  EXPECT_FALSE(read->body->cortex_HU);
  scene["body"]["cortex_HU"] = 1400;
  EXPECT_EQ(parse(scene)->body->cortex_HU, 1400);
  scene["body"]["cortex_HU"] = 0;
  scene["body"]["shell"]["thickness_m"] = 0.001;
  EXPECT_EQ(parse(scene)->body->shell_factor, 1);
  scene["body"]["to"] = 70;
  EXPECT_TRUE(parse(scene)) << "64 slices";
}

TEST(Scene, EveryChoiceOfTheCuttingLawIsRead) {
  json scene = fullest_of_cutting();
  const auto axis = [&](const char* name) {
    scene["force_law"]["axis"] = name;
    return parse(scene)->force_law.axis;
  };
  EXPECT_EQ(axis("auto"), ToolAxis::kAuto);
  EXPECT_EQ(axis("rigid"), ToolAxis::kRigid);
  EXPECT_EQ(axis("coupled"), ToolAxis::kCoupled);
  const auto prediction = [&](const char* name) {
    scene["force_law"]["prediction"] = name;
    return parse(scene)->force_law.prediction;
  };
  EXPECT_EQ(prediction("auto"), PosePrediction::kAuto);
  EXPECT_EQ(prediction("on"), PosePrediction::kOn);
  EXPECT_EQ(prediction("off"), PosePrediction::kOff);
  for (const char* other : {"hooke", "network"}) {
    json mixed = smallest();
    mixed["force_law"] = {{"kind", other}, {"tip_hold", 0.5}};
    EXPECT_FALSE(parse(mixed)) << "another law's parameter, " << other;
    mixed["force_law"] = {{"kind", other}, {"force_scale", 0.5}};
    EXPECT_EQ(parse(mixed)->force_law.force_scale, 0.5) << "every law has it, " << other;
  }
}

TEST(Scene, EverySolverHasItsParameter) {
  json scene = smallest();
  scene["force_law"] = {{"kind", "network"}};
  EXPECT_EQ(parse(scene)->force_law.solver, NetworkSolver::kAuto);
  scene["force_law"]["error_bound"] = 0.1;
  EXPECT_EQ(parse(scene)->force_law.error_bound, 0.1);
  scene["force_law"] = {{"kind", "network"}, {"solver", "propagation"}, {"depth", 12}};
  EXPECT_EQ(parse(scene)->force_law.depth, 12);
  scene["force_law"] = {{"kind", "network"}, {"solver", "global"}, {"depth", 12}};
  EXPECT_FALSE(parse(scene)) << "another solver's parameter";
  scene["force_law"] = {{"kind", "hooke"}, {"reach_m", 0.01}};
  EXPECT_FALSE(parse(scene));
}

TEST(Scene, TheDefaultHalfAngleOfAJamshidiIsThatOfAFlatEdge) {
  json scene = smallest();
  scene["tool"] = {{"kind", "jamshidi"}, {"radius_m", 2e-3}, {"inner_radius_m", 1e-3}};
  ASSERT_TRUE(parse(scene));
  EXPECT_EQ(parse(scene)->tool.half_angle_deg, 90);
  scene["tool"]["half_angle_deg"] = 30;  // tool_shape() refuses it
  EXPECT_EQ(parse(scene)->tool.half_angle_deg, 30);
  scene["tool"] = {{"kind", "trocar"}, {"radius_m", 2e-3}};
  EXPECT_EQ(parse(scene)->tool.half_angle_deg, 30);
}

TEST(Scene, AToolMayBeAnySimplePolygon) {
  json scene = smallest();
  const json arrow = {{0.004, 0}, {-0.003, 0.003}, {-0.001, 0}, {-0.003, -0.003}};
  scene["tool"]["outline_m"] = arrow;
  const auto forwards = parse(scene);
  ASSERT_TRUE(forwards) << forwards.error().message;
  EXPECT_EQ(forwards->tool.sides, 4);
  scene["tool"]["outline_m"] = json{arrow[3], arrow[2], arrow[1], arrow[0]};
  EXPECT_EQ(parse(scene)->tool.outline_m, forwards->tool.outline_m) << "turned round";
  for (const json& broken :
       {json{{0, 0}, {0.01, 0.01}, {0.01, 0}, {0, 0.01}}, json{{0, 0}, {0.01, 0}, {0.02, 0}},
        json{{0, 0}, {0.01, 0}, {0, 0}, {0, 0.01}}, json{{0, 0}, {0.01, 0}},
        json{{0, 0}, {0.1, 0}, {0, 0.1}}, json{{0, 0}, {0.01, 0, 0}, {0, 0.01}},
        json{{0, 0}, {0.01, "0"}, {0, 0.01}}, json{1, 2, 3}}) {
    scene["tool"]["outline_m"] = broken;
    const auto result = parse(scene);
    ASSERT_FALSE(result) << broken;
    EXPECT_NE(result.error().message.find("/tool/outline_m"), std::string::npos);
  }
  scene["tool"] = {{"outline_m", arrow}, {"sides", 6}};
  EXPECT_FALSE(parse(scene));
}

TEST(Scene, AnAnchorMayBeTheCentroid) {
  json scene = smallest();
  scene["placement"] = {{"anchor", "centroid"}};
  ASSERT_TRUE(parse(scene));
  EXPECT_FALSE(parse(scene)->placement.anchor_mm);
}

// The heights are decimals and their difference is rounded: 0.15 - 0.1499 is below 0.0001.
TEST(Scene, SlicesExactlyTheLeastGapApartAreTakenAtEveryHeight) {
  const auto both = [](double z_m, double other_z_m) {
    json scene = smallest();
    scene["slices"][0]["z_m"] = z_m;
    scene["slices"].push_back({{"index", 4}, {"z_m", other_z_m}});
    return parse(scene);
  };
  EXPECT_TRUE(both(0.14, 0.1399));
  EXPECT_TRUE(both(0.15, 0.1499));
  const auto typed = [](int um) { return std::stod(std::to_string(um) + "e-6"); };
  for (int um = -999'900; um <= 1'000'000; um += 100)
    ASSERT_TRUE(both(typed(um), typed(um - 100))) << um << " um";
  for (const double less_m : {1e-9, 1e-10, 1e-11}) {
    EXPECT_FALSE(both(0.15, 0.1499 + less_m)) << less_m;
    EXPECT_FALSE(both(-0.99, -0.9899 - less_m)) << less_m;
  }
}

struct Refusal {
  const char* pointer;  ///< JSON pointer at which the value is set
  json value;
  const char* named;  ///< must be in the message
};

/// Each change of `base`, which is good, is refused in one line that names file and place.
void expect_refused(const json& base, const std::same_as<Refusal> auto&... changes) {
  ASSERT_TRUE(parse(base));
  for (const Refusal& change : {changes...}) {
    SCOPED_TRACE(std::string(change.pointer) + " = " + change.value.dump());
    json scene = base;
    scene[json::json_pointer(change.pointer)] = change.value;
    const auto result = parse(scene);
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, ExitCode::kRefused);
    EXPECT_EQ(result.error().message.rfind("s.json: ", 0), 0U) << result.error().message;
    EXPECT_NE(result.error().message.find(change.named), std::string::npos)
        << result.error().message;
    EXPECT_EQ(result.error().message.find('\n'), std::string::npos);
  }
}

/// Each key of `base`, or of its object at `place`, is named if it is missing.
void expect_named_if_missing(const json& base, const std::string& place,
                             std::initializer_list<const char*> keys) {
  for (const char* key : keys) {
    json scene = base;
    scene[json::json_pointer(place)].erase(key);
    const auto result = parse(scene);
    ASSERT_FALSE(result) << key;
    EXPECT_NE(result.error().message.find(place + "/" + key + ": is missing"), std::string::npos)
        << result.error().message;
  }
}

TEST(Scene, WrongFieldsAreRefused) {
  expect_refused(
      fullest(), Refusal{"/schema", "trocar.scene/2", "/schema"}, Refusal{"/name", 7, "/name"},
      Refusal{"/name", "", "/name"}, Refusal{"/name", "a\nb", "/name"},
      Refusal{"/asset", nullptr, "/asset"}, Refusal{"/duration_s", 0, "/duration_s"},
      Refusal{"/duration_s", "2", "/duration_s"}, Refusal{"/rate_Hz", 99, "/rate_Hz"},
      Refusal{"/rate_Hz", 8001, "/rate_Hz"}, Refusal{"/extra", 1, "unknown key \"extra\""},
      Refusal{"/slices", json::array(), "/slices"}, Refusal{"/slices", json::object(), "/slices"},
      Refusal{"/slices/1/index", 1.5, "/slices/1/index"},
      Refusal{"/slices/1/index", -1, "/slices/1/index"},
      Refusal{"/slices/1/index", 18446744073709551615U, "/slices/1/index"},
      Refusal{"/slices/0/z_m", nullptr, "/slices/0/z_m"},
      Refusal{"/slices/1/z_m", 0.12005, "/slices/1/z_m"},
      Refusal{"/slices/0/zm", 1, "unknown key \"zm\""},
      Refusal{"/placement/anchor", "centroid", "both anchor and anchor_mm"},
      Refusal{"/placement/anchor_mm", json::array({1, 2, 3}), "/placement/anchor_mm"},
      Refusal{"/placement/anchor_mm", json::array({1, "2"}), "/placement/anchor_mm/1"},
      Refusal{"/placement/anchor_mm", json::array({1, 5000}), "/placement/anchor_mm/1"},
      Refusal{"/placement/mirror", true, "unknown key \"mirror\""},
      Refusal{"/placement", 3, "/placement"},
      Refusal{"/tissue/stiffness_N_per_m", -5000, "/tissue/stiffness_N_per_m"},
      Refusal{"/tissue/threshold_N", 1e300, "/tissue/threshold_N"},
      Refusal{"/tissue/shaft/dry_friction_N", -1, "/tissue/shaft/dry_friction_N"},
      Refusal{"/tissue/shaft/presliding_m", 0, "/tissue/shaft/presliding_m"},
      Refusal{"/tissues/1/name", "cortical", "/tissues/1/name: occurs twice"},
      Refusal{"/tissues/1/labels", json::array({3}), "both labels and hu"},
      Refusal{"/tissues/0/labels", json::array({1.5}), "/tissues/0/labels"},
      Refusal{"/tissues/0/labels", json::array(), "/tissues/0/labels"},
      Refusal{"/tissues/1/hu", json::array({400, 150}), "/tissues/1/hu"},
      Refusal{"/slices/0/tissue", "steel", "/slices/0/tissue: is not in /tissues"},
      Refusal{"/force_law/kind", "magic", "/force_law/kind"},
      Refusal{"/force_law/solver", "fast", "/force_law/solver"},
      Refusal{"/force_law/reach_m", 0, "/force_law/reach_m"},
      Refusal{"/force_law/radius_m", -1, "/force_law/radius_m"},
      Refusal{"/tool/tilt_deg", 46, "/tool/tilt_deg"},
      Refusal{"/hand/trajectory/1/rotation_deg", json::array({1, 2}), "rotation_deg"},
      Refusal{"/tool/sides", 2, "/tool/sides"}, Refusal{"/tool/sides", 33, "/tool/sides"},
      Refusal{"/tool/radius_m", 3, "/tool/radius_m"},
      Refusal{"/tool/tip_in_plate_m", 0, "/tool/tip_in_plate_m"},
      Refusal{"/hand", nullptr, "/hand"}, Refusal{"/hand/trajectory", json::array(), "/hand/tra"},
      Refusal{"/hand/trajectory/0/t_s", 0.1, "/hand/trajectory/0/t_s"},
      Refusal{"/hand/trajectory/1/t_s", 0, "/hand/trajectory/1/t_s"},
      Refusal{"/hand/trajectory/1/tip_m", json::array({0, 0, 2}), "/hand/trajectory/1/tip_m/2"},
      Refusal{"/hand/glove", 1, "unknown key \"glove\""},
      Refusal{"/hand/grip", "loose", "/hand/grip"}, Refusal{"/hand/mass_kg", -1, "/hand/mass_kg"},
      Refusal{"/hand/let_go_t_s", "never", "/hand/let_go_t_s"});
}

TEST(Scene, WrongFieldsOfTheCuttingLawAreRefused) {
  expect_refused(
      fullest_of_cutting(),
      Refusal{"/slices", json::array({{{"index", 3}, {"z_m", 0.12}}}), "/body"},
      Refusal{"/body", 3, "/body"}, Refusal{"/body/from", -1, "/body/from"},
      Refusal{"/body/from", 1.5, "/body/from"}, Refusal{"/body/from", 38, "/body/to"},
      Refusal{"/body/to", 67, "/body/to"}, Refusal{"/body/to", 1'000'001, "/body/to"},
      Refusal{"/body/top_z_m", 1.1, "/body/top_z_m"},
      Refusal{"/body/top_z_m", "top", "/body/top_z_m"},
      Refusal{"/body/up", 1, "unknown key \"up\""}, Refusal{"/body/shell", 0.001, "/body/shell"},
      Refusal{"/body/shell", json::object(), "/body/shell/thickness_m"},
      Refusal{"/body/shell/thickness_m", 0, "/body/shell/thickness_m"},
      Refusal{"/body/shell/thickness_m", 0.011, "/body/shell/thickness_m"},
      Refusal{"/body/shell/strength_factor", 0.05, "/body/shell/strength_factor"},
      Refusal{"/body/shell/strength_factor", 101, "/body/shell/strength_factor"},
      Refusal{"/body/shell/hu", 1, "unknown key \"hu\""},
      Refusal{"/body/cortex_HU", 1200, "/body/cortex_HU: cannot be given together"},
      Refusal{"/body/cortex_HU", -1, "/body/cortex_HU"},
      Refusal{"/body/cortex_HU", "dense", "/body/cortex_HU"},
      Refusal{"/tissue/cut", json::object(), "/tissue/cut: must have either"},
      Refusal{"/tissue/cut", true, "/tissue/cut"},
      Refusal{"/tissue/cut/bone", {{"law", "morgan"}}, "/tissue/cut: must have either"},
      Refusal{"/tissue/cut/strength_MPa", -1, "/tissue/cut/strength_MPa"},
      Refusal{"/tissue/cut/strength_MPa", 1001, "/tissue/cut/strength_MPa"},
      Refusal{"/tissue/cut/tearing_N_per_m", -1, "/tissue/cut/tearing_N_per_m"},
      Refusal{"/tissue/cut/tearing_N_per_m", 2e6, "/tissue/cut/tearing_N_per_m"},
      Refusal{"/tissue/cut/friction_kPa", -0.1, "/tissue/cut/friction_kPa"},
      Refusal{"/tissue/cut/friction_kPa", 1e6, "/tissue/cut/friction_kPa"},
      Refusal{"/tissue/cut/bed_N_per_mm3", -1, "/tissue/cut/bed_N_per_mm3"},
      Refusal{"/tissue/cut/bed_N_per_mm3", 1e5, "/tissue/cut/bed_N_per_mm3"},
      Refusal{"/tissue/cut/lateral_strength_MPa", 0, "/tissue/cut/lateral_strength_MPa"},
      Refusal{"/tissue/cut/lateral_strength_MPa", 2000, "/tissue/cut/lateral_strength_MPa"},
      Refusal{"/tissue/cut/depth", 1, "unknown key \"depth\""},
      Refusal{"/tissues/0/cut/bone/law", 1, "/tissues/0/cut/bone/law"},
      Refusal{"/tissues/0/cut/bone/law", "", "/tissues/0/cut/bone/law"},
      Refusal{"/tissues/0/cut/bone", json::object(), "/tissues/0/cut/bone/law"},
      Refusal{"/tissues/0/cut/bone/density", "wet", "/tissues/0/cut/bone/density"},
      Refusal{"/tissues/0/cut/bone/g_per_cm3_per_HU", 0.02, "/g_per_cm3_per_HU"},
      Refusal{"/tissues/0/cut/bone/g_per_cm3_per_HU", -0.001, "/g_per_cm3_per_HU"},
      Refusal{"/tissues/0/cut/bone/g_per_cm3_at_0_HU", 1.5, "/g_per_cm3_at_0_HU"},
      Refusal{"/tissues/0/cut/bone/author", "x", "unknown key \"author\""},
      Refusal{"/force_law/axis", "loose", "/force_law/axis"},
      Refusal{"/force_law/axis", 1, "/force_law/axis"},
      Refusal{"/force_law/coupling_N_per_m", 99, "/force_law/coupling_N_per_m"},
      Refusal{"/force_law/coupling_N_per_m", 2e6, "/force_law/coupling_N_per_m"},
      Refusal{"/force_law/coupling_Nm_per_rad", 0, "/force_law/coupling_Nm_per_rad"},
      Refusal{"/force_law/coupling_Nm_per_rad", 1e5, "/force_law/coupling_Nm_per_rad"},
      Refusal{"/force_law/prediction", "maybe", "/force_law/prediction"},
      Refusal{"/force_law/force_scale", 0, "/force_law/force_scale"},
      Refusal{"/force_law/force_scale", 11, "/force_law/force_scale"},
      Refusal{"/force_law/reach_m", 0.01, "unknown key \"reach_m\""});
}

json with_goals() {
  json scene = smallest();
  scene["goals"] = json::parse(R"({
    "target": {"at_m": [0.001, 0, 0.11], "radius_m": 0.003},
    "line": {"entry_m": [0.001, 0, 0.15], "entry_radius_m": 0.004, "corridor_m": 0.005},
    "force_max_N": 30, "time_max_s": 8, "plunge_max_m": 0.004,
    "zones": [
      {"name": "canal", "margin_m": 0.002,
       "prism": {"outline_m": [[0, 0.02], [0.01, 0.02], [0.01, 0.03], [0, 0.03]], "z_m": [0.1, 0.15]}},
      {"name": "vessel", "capsule": {"from_m": [0.03, 0, 0.1], "to_m": [0.03, 0, 0.2], "radius_m": 0.005}},
      {"name": "lung", "box": {"min_m": [-0.1, -0.1, 0.05], "max_m": [0.1, 0.1, 0.08]}}]})");
  return scene;
}

TEST(Scene, EveryGoalIsRead) {
  EXPECT_FALSE(parse(smallest())->goals);
  const auto scene = parse(with_goals());
  ASSERT_TRUE(scene) << scene.error().message;
  ASSERT_TRUE(scene->goals);
  const SceneGoals& goals = *scene->goals;
  ASSERT_TRUE(goals.target && goals.line);
  EXPECT_EQ(goals.target->at_m, (std::array{0.001, 0.0, 0.11}));
  EXPECT_EQ(goals.target->radius_m, 0.003);
  EXPECT_EQ(goals.line->entry_m, (std::array{0.001, 0.0, 0.15}));
  EXPECT_EQ(goals.line->direction, (std::array{0.0, 0.0, -1.0}));
  EXPECT_EQ(goals.line->entry_radius_m, 0.004);
  EXPECT_EQ(goals.line->corridor_m, 0.005);
  EXPECT_EQ(goals.force_max_N, 30);
  EXPECT_EQ(goals.time_max_s, 8);
  EXPECT_EQ(goals.plunge_max_m, 0.004);
  ASSERT_EQ(goals.zones.size(), 3U);
  EXPECT_EQ(goals.zones[0].name, "canal");
  EXPECT_EQ(goals.zones[0].margin_m, 0.002);
  EXPECT_EQ(goals.zones[0].shape, ForbiddenZone::Shape::kPrism);
  EXPECT_EQ(goals.zones[0].outline_m.at(2), (std::array{0.01, 0.03}));
  EXPECT_EQ(goals.zones[0].z_m, (std::array{0.1, 0.15}));
  EXPECT_EQ(goals.zones[1].shape, ForbiddenZone::Shape::kCapsule);
  EXPECT_EQ(goals.zones[1].high_m, (std::array{0.03, 0.0, 0.2}));
  EXPECT_EQ(goals.zones[1].radius_m, 0.005);
  EXPECT_EQ(goals.zones[2].shape, ForbiddenZone::Shape::kBox);
  EXPECT_EQ(goals.zones[2].low_m, (std::array{-0.1, -0.1, 0.05}));
  json given = with_goals();
  given["goals"]["line"]["direction"] = {0.3, 0, -0.4};
  EXPECT_NEAR(parse(given)->goals->line->direction[0], 0.6, 1e-15);
  given = with_goals();
  given["goals"]["line"]["to_m"] = {0.001, 0.2, 0.15};
  EXPECT_EQ(parse(given)->goals->line->direction, (std::array{0.0, 1.0, 0.0}));
  given = smallest();
  given["goals"] = json::object();
  EXPECT_TRUE(parse(given)->goals);
}

TEST(Scene, WrongGoalsAreRefused) {
  expect_refused(
      with_goals(), Refusal{"/goals", 3, "/goals"},
      Refusal{"/goals/score", 1, "unknown key \"score\""},
      Refusal{"/goals/target/at_m", json::array({0, 0}), "/goals/target/at_m"},
      Refusal{"/goals/target/radius_m", 0, "/goals/target/radius_m"},
      Refusal{"/goals/target", json::object(), "/goals/target/at_m: is missing"},
      Refusal{"/goals/line", json::object(), "/goals/line/entry_m: is missing"},
      Refusal{"/goals/line/direction", json::array({0, 0, 0}), "/goals/line/direction"},
      Refusal{"/goals/line/to_m", json::array({0.001, 0, 0.15}), "/goals/line: has no direction"},
      Refusal{"/goals/line/entry_radius_m", -1, "/goals/line/entry_radius_m"},
      Refusal{"/goals/line/corridor_m", 2, "/goals/line/corridor_m"},
      Refusal{"/goals/force_max_N", 0, "/goals/force_max_N"},
      Refusal{"/goals/time_max_s", 86401, "/goals/time_max_s"},
      Refusal{"/goals/plunge_max_m", "small", "/goals/plunge_max_m"},
      Refusal{"/goals/zones", json::array(), "/goals/zones"},
      Refusal{"/goals/zones/0/box", json::object(), "/goals/zones/0/box/min_m"},
      Refusal{"/goals/zones/0/box", json::parse(R"({"min_m": [0,0,0], "max_m": [1,1,1]})"),
              "/goals/zones/0: must have one of"},
      Refusal{"/goals/zones/1/name", "canal", "/goals/zones/1/name: occurs twice"},
      Refusal{"/goals/zones/1/capsule/radius_m", 0, "/goals/zones/1/capsule/radius_m"},
      Refusal{"/goals/zones/0/prism/outline_m", json::parse("[[0,0],[1,1],[1,0],[0,1]]"),
              "must be a simple polygon"},
      Refusal{"/goals/zones/0/prism/outline_m/1", json::array({0, 2}), "must be pairs"},
      Refusal{"/goals/zones/0/prism/z_m", json::array({0.2, 0.1}), "[lowest, highest]"},
      Refusal{"/goals/zones/2/box/max_m", json::array({0.1, -0.1, 0.08}), "must be above min_m"},
      Refusal{"/goals/zones/2/margin_m", 0.2, "/goals/zones/2/margin_m"},
      Refusal{"/goals/zones/2/sphere", 1, "unknown key \"sphere\""});
}

TEST(Scene, ALineWithoutAnyEndIsRefused) {
  json scene = with_goals();
  scene["goals"].erase("target");
  const auto result = parse(scene);
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().message.find("must have direction or to_m"), std::string::npos);
}

TEST(Scene, MissingKeysAreNamed) {
  expect_named_if_missing(fullest_of_cutting(), "/body", {"from", "to", "top_z_m"});
  expect_named_if_missing(smallest(), "",
                          {"schema", "name", "asset", "duration_s", "slices", "hand"});
}

TEST(Scene, BrokenTextIsRefused) {
  const std::string good = smallest().dump();
  ASSERT_TRUE(parse_scene(good, "s", ""));
  for (std::size_t length = 0; length < good.size(); ++length) {
    EXPECT_FALSE(parse_scene(good.substr(0, length), "s", "")) << length;
  }
  for (const char* text : {"[]", "null", "1", "{\"a\":1e999}", "{\"name\":\"\xff\"}", "{} {}"}) {
    EXPECT_FALSE(parse_scene(text, "s", "")) << text;
  }
  EXPECT_FALSE(parse_scene(std::string(100'000, '['), "s", ""));
  // Repeated keys.
  const std::string twice = "{\"name\": \"a\"," + good.substr(1);
  const auto result = parse_scene(twice, "s", "");
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().message.find("\"name\" occurs twice"), std::string::npos);
}

}  // namespace
}  // namespace trocar
