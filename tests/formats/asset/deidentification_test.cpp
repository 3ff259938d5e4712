// SPDX-License-Identifier: Apache-2.0
// What check_deidentified_asset() refuses: each kind of thing that could tell whose scan it was,
// planted in an asset that is valid otherwise.
#include "formats/asset/deidentification.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <functional>
#include <nlohmann/json.hpp>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/base/json.h"
#include "tests/support/glb_bytes.h"

namespace trocar {
namespace {

using Bytes = std::vector<std::uint8_t>;
using nlohmann::json;
using test::put_number;
using test::with_json;

Asset plain_asset() {
  Asset asset;
  asset.generator = "trocar-mesh 0.2.0";
  asset.parameters_json =
      R"({"axis":"coronal","contour":"subpixel","crop":[1,2,3,4],"fill_mm2":"all","grade_hu":50,"hu":false,"threshold":226.5})";
  asset.materials = {{"L3", 22}, {"disc L3/L4 (left)", {}}};
  AssetSlice slice;
  slice.mesh = {{{0, 0}, {300, 0}, {0, 300}}, {{0, 1, 2}}};
  slice.hu = {100, 200, 300};
  slice.pslg = boundary_rings(slice.mesh);
  for (int index = 0; index < 3; ++index) {
    slice.index = index;
    slice.z_mm = 0.7 * index;
    slice.T_lps_plane = Eigen::Translation3d(1, 2, slice.z_mm);
    asset.slices.push_back(slice);
  }
  return asset;
}

std::string found_in(const Bytes& glb) {
  EXPECT_TRUE(decode_asset(glb, "x.glb"));
  const auto ok = check_deidentified_asset(glb, "x.glb");
  if (ok) return {};
  EXPECT_EQ(ok.error().code, ExitCode::kRefused);
  EXPECT_EQ(ok.error().message.find('\n'), std::string::npos);
  return ok.error().message;
}

TEST(PrivateAsset, AnAssetAsItIsWrittenIsPrivate) {
  Asset asset = plain_asset();
  EXPECT_EQ(found_in(*encode_asset(asset)), "");
  asset.lines = true;
  asset.input_key_digest = std::string(64, 'a');
  EXPECT_EQ(found_in(*encode_asset(asset)), "");
  asset.colours = true;
  EXPECT_EQ(found_in(*encode_asset(asset)), "");
  for (const char* modality : {"MR", "PT", "RTDOSE", "CT LOCALIZER", "MR MOSAIC", "CT ED"}) {
    asset.parameters_json = std::string(R"({"modality":")") + modality + R"("})";
    EXPECT_EQ(found_in(*encode_asset(asset)), "");
  }
  asset.slices[1].measures_json = R"({"mean_hu":300.25,"patient":"DOE"})";
  asset.slices[1].hu.clear();
  EXPECT_EQ(found_in(*encode_asset(asset)), "");
}

TEST(PrivateAsset, AnUnknownModalityIsCalledOther) {
  for (const char* known : {"MR", "OT", "CT LOCALIZER", "CT SECONDARY CAPTURE", "CT Z_EFF"})
    EXPECT_EQ(shared_modality(known), known);
  for (const char* unknown : {"", " ", "SMITH", "ROE JANE", "CT SMITH", "CT ", "CT LOCALIZER SMITH",
                              "LOCALIZER", "M?", "mr"})
    EXPECT_EQ(shared_modality(unknown), "OT") << unknown;
}

TEST(PrivateAsset, PlantedTextIsNamed) {
  const std::vector<std::pair<std::function<void(Asset&)>, std::string>> planted{
      {[](Asset& a) { a.parameters_json = R"({"patient":1})"; },
       "its JSON has /extras/trocar/parameters/patient"},
      {[](Asset& a) { a.parameters_json = R"({"series":"1.2.826.0.1"})"; },
       "its JSON has /extras/trocar/parameters/series"},
      {[](Asset& a) { a.parameters_json = R"({"axis":"DOE"})"; },
       R"(its JSON has /extras/trocar/parameters/axis "DOE")"},
      {[](Asset& a) { a.parameters_json = R"({"modality":"1.2.826.0.1"})"; },
       R"(its JSON has /extras/trocar/parameters/modality "1.2.826.0.1")"},
      {[](Asset& a) { a.parameters_json = R"({"modality":"SMITH"})"; },
       R"(its JSON has /extras/trocar/parameters/modality "SMITH")"},
      {[](Asset& a) { a.parameters_json = R"({"modality":"CT SMITH"})"; },
       R"(its JSON has /extras/trocar/parameters/modality "CT SMITH")"},
      {[](Asset& a) { a.parameters_json = R"({"labels":["DOE"]})"; },
       R"(its JSON has /extras/trocar/parameters/labels/[] "DOE")"},
      {[](Asset& a) { a.generator = "trocar-mesh 0.2.0 /home/doe"; },
       R"(its JSON has /asset/generator "trocar-mesh 0.2.0 /home/doe")"},
      {[](Asset& a) { a.materials[1].name = "DOE 19470213"; }, "19470213"},
      {[](Asset& a) { a.materials[1].name = "1.2.826.0.1"; }, "1.2.826.0.1"},
      {[](Asset& a) { a.input_key_digest = "42ba"; }, "input_key_digest"}};
  for (const auto& [plant, what] : planted) {
    Asset asset = plain_asset();
    plant(asset);
    const std::string found = found_in(*encode_asset(asset));
    EXPECT_NE(found.find("x.glb: not de-identified: its JSON has /"), std::string::npos) << found;
    EXPECT_NE(found.find(what), std::string::npos) << found;
  }
}

TEST(PrivateAsset, BytesThatBelongToNothingAreFound) {
  Asset asset = plain_asset();
  Bytes glb = *encode_asset(asset);
  const auto last_record = [&glb] {
    MemorySource source(glb);
    return *read_record(source, **find_index(source), 2);
  };
  for (int step = 1; last_record().draco_bytes % 4 == 0; ++step) {  // until there is padding
    ASSERT_LT(step, 100);
    for (float& hu : asset.slices[2].hu)
      hu += static_cast<float>(8 * step * step);
    glb = *encode_asset(asset);
  }
  const EntryRecord last = last_record();
  MemorySource source(glb);
  const IndexedFile file = **find_index(source);
  Bytes gap = glb;
  gap[file.binary_at + last.draco_offset + last.draco_bytes] = 'D';
  EXPECT_NE(found_in(gap).find("do not belong to any content"), std::string::npos);

  Bytes longer = glb;  // four bytes at the end, with all sizes right
  longer.insert(longer.end(), {'D', 'O', 'E', 0});
  put_number(longer, 8, longer.size());
  put_number(longer, file.binary_at - 8, file.header.binary_bytes + 4);
  put_number(longer, file.binary_at + offsetof(IndexHeader, binary_bytes),
             file.header.binary_bytes + 4);
  EXPECT_NE(found_in(longer).find("do not belong to any content"), std::string::npos);

  Bytes chunk = glb;  // a chunk of another kind
  chunk.insert(chunk.end(), {4, 0, 0, 0, 'D', 'O', 'E', 0, 1, 2, 3, 4});
  put_number(chunk, 8, chunk.size());
  EXPECT_NE(found_in(chunk).find("chunks beside"), std::string::npos);

  Bytes spaces = glb;  // a space for each of the JSON's bytes could be a text
  spaces.insert(spaces.begin() + static_cast<std::ptrdiff_t>(file.binary_at - 8), 4, ' ');
  put_number(spaces, 8, spaces.size());
  put_number(spaces, 12, file.header.json_bytes + 4);
  put_number(spaces, file.binary_at + 4 + offsetof(IndexHeader, json_bytes),
             file.header.json_bytes + 4);
  EXPECT_NE(found_in(spaces).find("more characters"), std::string::npos);
}

/// The asset with a text in its binary chunk, in a buffer view that `refer` may refer to.
Bytes with_text(const Bytes& glb, const std::function<void(json&, std::size_t view)>& refer) {
  MemorySource source(glb);
  const IndexedFile file = **find_index(source);
  json document = json::parse(test::json_of(glb));
  const std::string hidden = "DOE^JANE 19700101 PID4711...";
  const std::size_t end = file.header.binary_bytes, view = document["bufferViews"].size();
  document["bufferViews"].push_back(
      {{"buffer", 0}, {"byteOffset", end}, {"byteLength", hidden.size()}});
  document["buffers"][0]["byteLength"] = end + hidden.size();
  refer(document, view);
  Bytes out = with_json(glb, json_text(document));
  const std::size_t binary_at = test::binary_at(out);
  out.insert(out.end(), hidden.begin(), hidden.end());
  put_number(out, 8, out.size());
  put_number(out, binary_at - kGlbChunkHeader, end + hidden.size());
  put_number(out, binary_at + offsetof(IndexHeader, json_bytes), binary_at - 28);
  put_number(out, binary_at + offsetof(IndexHeader, binary_bytes), end + hidden.size());
  return out;
}

TEST(PrivateAsset, ContentThatNoSceneShowsIsFound) {
  const Bytes glb = *encode_asset(plain_asset());
  const auto found = [&glb](const std::function<void(json&, std::size_t)>& refer) {
    const auto ok = check_deidentified_asset(with_text(glb, refer), "x.glb");
    return ok ? "" : ok.error().message;
  };
  const auto mesh_of = [](json& document, std::size_t view) {
    json mesh = document["meshes"][0];
    mesh["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["bufferView"] = view;
    return mesh;
  };
  EXPECT_NE(found([](json&, std::size_t) {}).find("buffer view"), std::string::npos);
  EXPECT_NE(
      found([](json& document, std::size_t view) {
        document["accessors"].push_back(
            {{"bufferView", view}, {"componentType", 5125}, {"count", 7}, {"type", "SCALAR"}});
      }).find("accessor "),
      std::string::npos);
  EXPECT_NE(found([&](json& document, std::size_t view) {
              document["meshes"].push_back(mesh_of(document, view));
            }).find("mesh "),
            std::string::npos);
  const auto add_node = [&](json& document, std::size_t view) {
    document["meshes"].push_back(mesh_of(document, view));
    document["nodes"].push_back({{"mesh", document["meshes"].size() - 1}});
  };
  EXPECT_NE(found(add_node).find("node "), std::string::npos);
  EXPECT_EQ(found([&](json& document, std::size_t view) {
              add_node(document, view);
              document["scenes"][0]["nodes"].push_back(document["nodes"].size() - 1);
            }),
            "")
      << "a mesh that the scene shows is for decode_asset()";
}

TEST(PrivateAsset, PlainNames) {
  for (const char* name :
       {"L3", "disc L3-L4", "vertebra_22", "bone, skin (left)/rib+lung", "1234", "Left Femur",
        "INFERIOR_VENA_CAVA", "rib_left_12", "vertebrae_T10 + 3 more", "disc L3/L4, L4/L5",
        "femur R + femur L", "rib_left_10 + rib_left_11 + rib_left_12", "T13", "vertebra22",
        "vertebrae_T10 + vertebrae_T11 + vertebrae_L1"})
    EXPECT_TRUE(is_plain_name(name)) << name;
  for (const char* name :
       {"", "1.2", "12345", "19470213", "1947-02-13", "13/02/1947", "13, 2, 1947", "L3 1234-5678",
        "D\xC3\xB6", "a\tb", "a\nb", "x@y", "C:", "Doe, Jane", "MUSTER_HANS", "Maria Muster",
        "femur of Smith", "femurSmith",
        // Spelt, or hidden in joined tokens.
        "M u l l e r", "M_u_l_l_e_r", "M+u+l+l+e+r", "M1u1l1l1e1r", "P1234B5678", "P 1234 B 5678",
        "bone 1234 rib 5678", "rib1234rib5678", "12+34+56+78", "L L", "R, L", "T 12", "22a", "T14",
        "L7", "a", "label 614454277", "a, b (left)/c+d"})
    EXPECT_FALSE(is_plain_name(name)) << name;
  // Numbers of labels are known from elsewhere in the asset.
  const std::set<std::int64_t> labels{20, 21, 22, 23, 24, 614454277};
  for (const char* name : {"20+21+22+23+24", "label 614454277", "label 20 + label 614454277"})
    EXPECT_TRUE(is_plain_name(name, labels)) << name;
  for (const char* name : {"label 614454278", "label 0614454277", "label 6144542770000"})
    EXPECT_FALSE(is_plain_name(name, labels)) << name;
  EXPECT_TRUE(is_plain_name(std::string(64, '1').replace(4, 60, 60, ' ')));
  EXPECT_FALSE(is_plain_name(std::string(65, ' ')));
  EXPECT_FALSE(is_plain_name(std::string_view("a\0b", 3)));
}

}  // namespace
}  // namespace trocar
