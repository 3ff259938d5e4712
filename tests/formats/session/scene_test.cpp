// SPDX-License-Identifier: Apache-2.0
#include "formats/session/scene.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

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
  EXPECT_EQ(scene->force_law.reach_m, 0.02);
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

TEST(Scene, ShippedScenesLoad) {
  for (const char* name : {"one_slice.json", "three_slices.json"}) {
    const auto scene = read_scene(std::filesystem::path(TROCAR_SCENES) / name);
    ASSERT_TRUE(scene) << scene.error().message;
    EXPECT_EQ(scene->asset.filename(), "sample.glb");
    EXPECT_EQ(scene->tissue.stiffness_N_per_m, 5000);
    EXPECT_EQ(scene->tissue.threshold_N, 35);
  }
}

struct Refusal {
  const char* pointer;  ///< where the value is put; empty: removed from `key`
  json value;
  const char* named;  ///< must be in the message
};

// Otherwise googletest would print the bytes, including padding.
void PrintTo(const Refusal& refusal, std::ostream* out) {
  *out << refusal.pointer << " = " << refusal.value;
}

class Refused : public testing::TestWithParam<Refusal> {};

TEST_P(Refused, NamesFileAndPlaceInOneLine) {
  json scene = fullest();
  scene[json::json_pointer(GetParam().pointer)] = GetParam().value;
  const auto result = parse(scene);
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ExitCode::kRefused);
  EXPECT_EQ(result.error().message.rfind("s.json: ", 0), 0U) << result.error().message;
  EXPECT_NE(result.error().message.find(GetParam().named), std::string::npos)
      << result.error().message;
  EXPECT_EQ(result.error().message.find('\n'), std::string::npos);
}

INSTANTIATE_TEST_SUITE_P(
    Scene, Refused,
    testing::Values(
        Refusal{"/schema", "trocar.scene/2", "/schema"}, Refusal{"/name", 7, "/name"},
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
        Refusal{"/hand/let_go_t_s", "never", "/hand/let_go_t_s"}));

TEST(Scene, MissingKeysAreNamed) {
  for (const char* key : {"schema", "name", "asset", "duration_s", "slices", "hand"}) {
    json scene = smallest();
    scene.erase(key);
    const auto result = parse(scene);
    ASSERT_FALSE(result) << key;
    EXPECT_NE(result.error().message.find(std::string("/") + key + ": is missing"),
              std::string::npos)
        << result.error().message;
  }
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

TEST(Scene, AMissingFileIsRefused) {
  const auto result = read_scene("/no/such/scene.json");
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ExitCode::kRefused);
  EXPECT_NE(result.error().message.find("/no/such/scene.json"), std::string::npos);
}

}  // namespace
}  // namespace trocar
