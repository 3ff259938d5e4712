// SPDX-License-Identifier: GPL-3.0-or-later
// The canonical parameters of scans: what is in a key.
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <set>
#include <string>

#include "formats/asset/asset.h"
#include "formats/asset/deidentification.h"
#include "formats/base/command_line.h"
#include "formats/mesh/slice_mesh.h"
#include "pipeline/program/arguments.h"
#include "pipeline/program/commands.h"
#include "tests/support/temporary_folder.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

json canonical(const json& given) {
  const auto out = FarmScans().parameters(given);
  EXPECT_TRUE(out) << given << ": " << (out ? "" : out.error().message);
  return out ? out->canonical : json();
}

TEST(Parameters, SayingADefaultChangesNothing) {
  const json plain = canonical(json::object());
  for (const json& given : std::initializer_list<json>{{{"threshold", 226}},
                                                       {{"threshold", "226.0"}},
                                                       {{"simplify", "area"}},
                                                       {{"contour", "subpixel"}},
                                                       {{"min-angle", 30}},
                                                       {{"max-area", 50}},
                                                       {{"grade", 0}},
                                                       {{"close", 0}},
                                                       {{"min-volume", 0}},
                                                       {{"largest", 0}},
                                                       {{"preset", "bone"}}})
    EXPECT_EQ(canonical(given), plain) << given;
}

// Such a default is smaller for small pixels, a value that is given is not.
TEST(Parameters, ADefaultThatFollowsThePixelIsNotThatValueGiven) {
  for (const json& given : std::initializer_list<json>{
           {{"tolerance", 0.2}}, {{"min-region", 1}}, {{"lattice-bits", 8}}})
    EXPECT_NE(canonical(given), canonical(json::object())) << given;
  const json preset = {{"preset", "vertebra"}};
  for (const json& given : std::initializer_list<json>{{{"close", 3}}, {{"min-volume", 100}}}) {
    json both = preset;
    both.update(given);
    EXPECT_NE(canonical(both), canonical(preset)) << given;
  }
}

// Images without --threshold are refused, so for them it must not be the same as its default.
TEST(Parameters, AThresholdGivenForImagesIsNotItsDefault) {
  const json images = {{"spacing", "1,1,1"}};
  json given = images;
  given["threshold"] = 226;
  EXPECT_NE(canonical(given), canonical(images));
}

TEST(Parameters, TheSameInOtherWordsIsTheSame) {
  EXPECT_EQ(canonical({{"labels", "20-22"}}), canonical({{"labels", {20, "22", 21}}}));
  EXPECT_EQ(canonical({{"labels", "21+20,3"}}), canonical({{"labels", {"3", "20+21"}}}));
  EXPECT_EQ(canonical({{"axis", "axial"}}), canonical({{"axis", "transverse"}}));
  EXPECT_EQ(canonical({{"crop", "0:9,1:8"}}), canonical({{"crop", " 0:9,01:8"}}));
  EXPECT_EQ(canonical({{"spacing", "0.30,0.3,1"}}), canonical({{"spacing", "0.3,0.3,1.0"}}));
  EXPECT_EQ(canonical({{"preset", "vertebra"}, {"close", 3}, {"min-volume", 100}}),
            canonical({{"threshold", 180}, {"close", 3}, {"fill", 2500}, {"min-volume", 100}}));
  EXPECT_EQ(canonical({{"preset", "skin"}, {"threshold", 180}})["threshold"], 180);
}

// Returns what `trocar-mesh verify --private` says of an asset that was made with these options.
std::string privacy_of(const json& given) {
  CLI::App app;
  Arguments arguments;
  add_mesh_options(app, arguments);
  std::vector<std::string> words{"trocar-mesh"};
  for (const auto& [name, value] : given.items()) {
    std::string& word = words.emplace_back("--" + name);
    if (value != true)
      word.append("=").append(value.is_string() ? value.get<std::string>() : value.dump());
  }
  if (const auto ok = parse(app, words); !ok) return ok.error().message;
  if (const auto ok = complete(arguments); !ok) return ok.error().message;
  Asset asset;
  asset.generator = "trocar-mesh 0.2.0";
  asset.parameters_json = parameters_json(arguments.stack, arguments.open).dump();
  asset.materials = {{"L3", 22}};
  AssetSlice slice;
  slice.mesh = {{{0, 0}, {300, 0}, {0, 300}}, {{0, 1, 2}}};
  slice.pslg = boundary_rings(slice.mesh);
  asset.slices.push_back(slice);
  const auto ok = check_deidentified_asset(*encode_asset(asset), "x.glb");
  return ok ? "" : ok.error().message;
}

// A new option is either in the key, or named here: a missing one would leave stale assets. And an
// asset that was made with it passes the de-identification check.
TEST(Parameters, EveryOptionIsInTheKeyOrNamesAFile) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "key") << std::string(16, 'k');
  std::ofstream(folder / "names.json") << R"({"20": "L1"})";
  const json labels = {{"labels", "all"}};
  const std::map<std::string, json> others = {
      // beside which other parameters, and a value
      {"threshold", {json::object(), 100}},
      {"equalize", {json::object(), 200}},
      {"labels", {json::object(), "1"}},
      {"contour", {json::object(), "pixel"}},
      {"simplify", {json::object(), "dp"}},
      {"tolerance", {json::object(), 0.3}},
      {"min-angle", {json::object(), 20}},
      {"max-area", {json::object(), 40}},
      {"max-area-px", {json::object(), 40}},
      {"grade", {json::object(), 100}},
      {"min-region", {json::object(), 2}},
      {"names", {labels, "verse"}},
      {"hu", {labels, "ct.nii"}},
      {"close", {{{"fill", "all"}}, 1}},
      {"fill", {json::object(), "all"}},
      {"min-volume", {json::object(), 9}},
      {"keep", {{{"fill", "all"}}, "column"}},
      {"keep-table", {json::object(), true}},
      {"largest", {json::object(), 2}},
      {"seed", {json::object(), "1,2,3"}},
      {"mask", {json::object(), "m.nii:3"}},
      {"surface", {json::object(), true}},
      {"surface-triangles", {{{"surface", true}}, 50000}},
      {"spacing", {json::object(), "1,1,1"}},
      {"volume", {json::object(), 1}},
      {"slices", {json::object(), "0:1"}},
      {"crop", {json::object(), "0:9,0:9"}},
      {"any-modality", {json::object(), true}},
      {"completeness-unknown", {json::object(), true}},
      {"axis", {json::object(), "coronal"}},
      {"no-hu", {json::object(), true}},
      {"context", {json::object(), "3"}},
      {"preset", {json::object(), "skin"}},
      {"lattice-bits", {json::object(), 7}},
      {"lines", {json::object(), true}},
      {"colour", {json::object(), true}},
      {"input-key", {json::object(), (folder / "key").string()}}};
  const std::set<std::string> files = {"hu", "input-key"};  // by the digests of their files only
  const auto names = collection_options();
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()).size(), others.size());
  for (const std::string& name : names) {
    ASSERT_TRUE(others.contains(name)) << name << " is a new option: is it in the key?";
    json given = others.at(name)[0];
    const auto before = FarmScans().parameters(given);
    given[name] = others.at(name)[1];
    const auto after = FarmScans().parameters(given);
    ASSERT_TRUE(before && after) << name << ": " << (after ? "" : after.error().message);
    EXPECT_EQ(privacy_of(given), "") << name;
    if (files.contains(name)) {
      ASSERT_EQ(after->files.size(), 1u) << name;
      EXPECT_EQ(after->files[0].of, name);
    } else {
      EXPECT_NE(before->canonical, after->canonical) << name;
    }
  }
  const auto mask = FarmScans().parameters({{"mask", "m.nii:3"}});
  ASSERT_EQ(mask->files.size(), 1u);
  EXPECT_EQ(mask->files[0].path, "m.nii");
  const auto table =
      FarmScans().parameters({{"labels", "all"}, {"names", (folder / "names.json").string()}});
  ASSERT_EQ(table->files.size(), 1u);
  EXPECT_EQ(table->files[0].of, "names");
  EXPECT_EQ(table->canonical["names"], json());  // its path is not part of the key
}

TEST(Parameters, ADefaultOfSurfaceTrianglesMayBeExceededAndTheSameNumberMayNot) {
  EXPECT_NE(canonical({{"surface", true}}),
            canonical({{"surface", true}, {"surface-triangles", 50000}}));
}

TEST(Parameters, WhatIsWrongIsSaidInTheWordsOfTheCommandLine) {
  const auto message = [](const json& given) {
    const auto out = FarmScans().parameters(given);
    return out ? std::string("accepted") : out.error().message;
  };
  EXPECT_EQ(message({{"tolerence", 1}}),
            "parameter tolerence: no such option, did you mean tolerance?");
  EXPECT_EQ(message({{"tolerance", -1}}), "parameters: --tolerance -1: must be within 0 and 10000");
  EXPECT_EQ(message({{"jobs", 1}}), "parameter jobs: is not for the scans of a collection");
  EXPECT_EQ(message({{"lines", 1}}), "parameter lines: must be true or false");
  const auto missing = FarmScans().parameters({{"labels", "1"}, {"names", "/nowhere.json"}});
  ASSERT_FALSE(missing);  // a file that is not there is the scan's failure, not the collection's
  EXPECT_EQ(missing.error().code, ExitCode::kRefused);
}

}  // namespace
}  // namespace trocar::pipeline
