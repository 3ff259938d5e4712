// SPDX-License-Identifier: Apache-2.0
// Which tissue a slice got and why, and the warning where none fits.
#include "runtime/check/scene_check.h"

#include <gtest/gtest.h>

#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

NamedTissue named(const char* name, std::vector<int> labels,
                  std::optional<std::array<double, 2>> hu) {
  NamedTissue tissue;
  tissue.name = name;
  tissue.labels = std::move(labels);
  tissue.hu = hu;
  return tissue;
}

struct Case {
  Scene scene = test::descent_scene({0.12, 0.14, 0.13}, 0.2, 0.1, 0.015);
  Asset asset = test::square_asset(3);
  std::vector<SliceTissue> chosen() const { return choose_tissues(scene, asset); }
  std::string warning() const { return warn_of_unfitting(scene, chosen()).value_or("none"); }
  std::string why(std::size_t i) const { return describe_choice(scene, chosen()[i].choice); }
};

TEST(SliceNames, AreRuns) {
  EXPECT_EQ(name_slices({3}), "slice 3");
  EXPECT_EQ(name_slices({5, 3, 4, 9, 4}), "slices 3-5, 9");
  std::vector<int> odd;
  odd.reserve(40);
  for (int i = 0; i < 40; ++i)
    odd.push_back(2 * i + 1);
  EXPECT_EQ(name_slices(odd), "slices 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23 and 28 more");
}

TEST(TissueAssignment, TopmostFirstWithTheReason) {
  Case c;
  c.scene.tissues = {named("only by name", {}, {}), named("bone", {22, 23}, {}),
                     named("fat", {}, {{-100, 100}})};
  c.asset.slices[1].measures_json = R"({"mean_hu":12.3})";
  c.scene.slices[2].tissue = "only by name";
  ASSERT_EQ(c.chosen().size(), 3U);
  EXPECT_EQ(c.chosen()[0].slice, 1);
  EXPECT_EQ(c.why(0), "tissue \"fat\": mean HU 12");
  EXPECT_EQ(c.why(1), "tissue \"only by name\": named by the slice");
  EXPECT_EQ(c.why(2), "the default tissue: no other fits");
  c.asset.parameters_json = R"({"labels":[22]})";
  EXPECT_EQ(c.why(0), "tissue \"bone\": the asset's label 22");
  c.scene.tissues.clear();
  EXPECT_EQ(c.why(0), "the default tissue");
  c.scene.tissue_is_given = true;
  EXPECT_EQ(c.why(0), "the scene's \"tissue\"");
}

TEST(TissueAssignment, WarnsOfADefaultThatNobodyChose) {
  Case c;
  EXPECT_EQ(c.warning(), "none") << "no tissues: the default is meant";
  c.scene.tissues = {named("only by name", {}, {})};
  EXPECT_EQ(c.warning(), "none") << "a slice without a name has the default";
  c.scene.tissues.push_back(named("bone", {}, {{300, 1500}}));
  c.scene.tissues.push_back(named("disc", {101, 102}, {}));
  EXPECT_EQ(
      c.warning(),
      "slices 0-2: none of the scene's tissues fits (no mean HU in the asset; the scene has "
      "\"bone\" 300 to 1500 HU, \"disc\" labels 101, 102): the default of 5000 N/m and 35 N is "
      "taken; change a tissue's labels or hu, name a tissue in the slice, or give the scene a "
      "\"tissue\"");
  c.asset.slices[0].measures_json = R"({"mean_hu":299})";
  c.asset.slices[1].measures_json = R"({"mean_hu":301})";
  c.asset.slices[2].measures_json = R"({"mean_hu":1600})";
  EXPECT_NE(c.warning().find("slices 0, 2: "), std::string::npos) << c.warning();
  EXPECT_NE(c.warning().find("mean HU 299 to 1600;"), std::string::npos) << c.warning();
  c.scene.tissue_is_given = true;
  EXPECT_EQ(c.warning(), "none") << "the scene says what the rest gets";
}

}  // namespace
}  // namespace trocar::runtime
