// SPDX-License-Identifier: Apache-2.0
#include "formats/session/scene.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "formats/session/device_description.h"
#include "tests/formats/session/documents.h"

namespace trocar {
namespace {

using nlohmann::json;

json good_document(const char* name) {
  return test::documents().at(name).at("good");
}
json smallest() {
  return good_document("smallest");
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
  const auto scene = parse(good_document("fullest"));
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

TEST(Scene, EveryFieldOfTheCuttingLawIsRead) {
  const auto scene = parse(good_document("cutting"));
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
  EXPECT_EQ(read->force_law.force_scale, 1);
  const CutTissue& cut = *read->tissue.cut;
  EXPECT_EQ(*cut.bone, (BoneByHu{"kopperdahl-power", "qct", 8e-4, 0, false}))
      << "a calibration that is not given is said to be assumed";
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
  json scene = good_document("cutting");
  const auto axis = [&](const char* name) {
    scene["force_law"]["axis"] = name;
    return parse(scene)->force_law.axis;
  };
  EXPECT_EQ(axis("auto"), ToolAxis::kAuto);
  EXPECT_EQ(axis("rigid"), ToolAxis::kRigid);
  EXPECT_EQ(axis("coupled"), ToolAxis::kCoupled);
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

TEST(Documents, WrongOnesAreRefusedInOneLineThatNamesThePlace) {
  const auto error_of = [](const std::string& kind, const std::string& text) {
    const auto said = [](const auto& read) {
      return read ? std::optional<Error>() : std::optional(read.error());
    };
    if (kind == "device") return said(parse_device_description(text, "s.json"));
    if (kind == "pose device") return said(parse_pose_device_description(text, "s.json"));
    return said(parse_scene(text, "s.json", "/data"));
  };
  for (const auto& [kind, document] : test::documents().items()) {
    const json& base = document["good"];
    ASSERT_FALSE(error_of(kind, base.dump())) << kind;
    for (const json& row : document["wrong"]) {
      SCOPED_TRACE(kind + ": " + row.dump());
      const json::json_pointer at(row[0].get<std::string>());
      json changed = base;
      if (row.size() == 1) {
        changed[at.parent_pointer()].erase(at.back());
      } else {
        changed[at] = row[1];
      }
      const auto error = error_of(kind, changed.dump());
      ASSERT_TRUE(error);
      EXPECT_EQ(error->code, ExitCode::kRefused);
      EXPECT_TRUE(error->message.starts_with("s.json: ")) << error->message;
      EXPECT_EQ(error->message.find('\n'), std::string::npos);
      const std::string named = row.size() == 1   ? at.to_string() + ": is missing"
                                : row.size() == 3 ? row[2].get<std::string>()
                                                  : at.to_string();
      EXPECT_NE(error->message.find(named), std::string::npos) << error->message;
    }
  }
}

TEST(Scene, EveryGoalIsRead) {
  EXPECT_FALSE(parse(smallest())->goals);
  const auto scene = parse(good_document("goals"));
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
  json given = good_document("goals");
  given["goals"]["line"]["direction"] = {0.3, 0, -0.4};
  EXPECT_NEAR(parse(given)->goals->line->direction[0], 0.6, 1e-15);
  given = good_document("goals");
  given["goals"]["line"]["to_m"] = {0.001, 0.2, 0.15};
  EXPECT_EQ(parse(given)->goals->line->direction, (std::array{0.0, 1.0, 0.0}));
  given = smallest();
  given["goals"] = json::object();
  EXPECT_TRUE(parse(given)->goals);
}

TEST(Scene, ALineWithoutAnyEndIsRefused) {
  json scene = good_document("goals");
  scene["goals"].erase("target");
  const auto result = parse(scene);
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().message.find("must have direction or to_m"), std::string::npos);
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
