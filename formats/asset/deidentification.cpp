// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/deidentification.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <tuple>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"

namespace trocar {
namespace {

using nlohmann::json;

bool is_any_of(std::string_view text, std::initializer_list<std::string_view> choices) {
  return std::find(choices.begin(), choices.end(), text) != choices.end();
}

// The kind of value allowed at a path of the JSON.
enum class Kind { kNumber, kFlag, kObject, kList, kText, kName, kNumberOrText };
struct Allowed {
  Kind kind = Kind::kNumber;
  std::function<bool(const std::string&)> text = {};
};

// The words of a text, which are separated by blanks.
std::vector<std::string> words_of(const std::string& text) {
  std::istringstream words(text);
  using Word = std::istream_iterator<std::string>;
  return {Word(words), Word()};
}

// The allowed values, by path; [] stands for any element of a list.
const std::map<std::string, Allowed>& allowed_values() {
  static const auto all = [] {
    std::map<std::string, Allowed> out;
    // Each word of `names` is a path below `base`; a dot is `base` itself.
    const auto add = [&out](Kind kind, const std::string& base, const char* names) {
      for (const std::string& word : words_of(names)) {
        std::string path = base;
        if (word != ".") path.append("/").append(word);
        out[std::move(path)] = {kind};
      }
    };
    const auto add_text = [&out](const char* path, bool (*text)(const std::string&)) {
      out[path] = {Kind::kText, text};
    };
    // Each word of `choices` is an allowed text.
    const auto add_choices = [&out](Kind kind, const std::string& path, const char* choices) {
      out[path] = {kind, [words = words_of(choices)](const std::string& text) {
                     return std::find(words.begin(), words.end(), text) != words.end();
                   }};
    };
    const std::string primitive = "/meshes/[]/primitives/[]",
                      draco = primitive + "/extensions/KHR_draco_mesh_compression",
                      trocar = "/extras/trocar", parameters = trocar + "/parameters",
                      node = "/nodes/[]", node_trocar = node + "/extras/trocar";
    add(Kind::kObject, "",
        ". asset materials/[] scenes/[] buffers/[] bufferViews/[] accessors/[] meshes/[] nodes/[] "
        "extras extras/trocar extras/trocar/materials/[] extras/trocar/parameters "
        "nodes/[]/extras nodes/[]/extras/trocar extras/trocar/hu_volumes/[]");
    add(Kind::kObject, "/materials/[]",
        "pbrMetallicRoughness extensions extensions/KHR_materials_unlit");
    add(Kind::kObject, primitive, ". attributes extensions");
    add(Kind::kObject, draco, ". attributes");
    add(Kind::kList, "",
        "extensionsRequired extensionsUsed materials scenes scenes/[]/nodes buffers bufferViews "
        "accessors accessors/[]/min accessors/[]/max meshes meshes/[]/primitives nodes "
        "materials/[]/pbrMetallicRoughness/baseColorFactor extras/trocar/materials "
        "extras/trocar/hu_volumes extras/trocar/hu_volumes/[]/origin_mm "
        "extras/trocar/hu_volumes/[]/pitch_mm extras/trocar/hu_volumes/[]/size");
    add(Kind::kList, node, "children matrix translation extras/trocar/mean_hu");
    add(Kind::kList, parameters,
        "labels joined_labels joined_labels/[] slices crop spacing_mm seeds_lps_mm "
        "seeds_lps_mm/[] mask_labels");
    add(Kind::kNumber, "", "scene scenes/[]/nodes/[] buffers/[]/byteLength");
    add(Kind::kNumber, "/materials/[]/pbrMetallicRoughness", "baseColorFactor/[] metallicFactor");
    add(Kind::kNumber, "/bufferViews/[]", "buffer byteOffset byteLength target");
    add(Kind::kNumber, "/accessors/[]", "bufferView componentType count min/[] max/[]");
    add(Kind::kNumber, primitive, "mode material indices");
    add(Kind::kNumber, draco, "bufferView");
    for (const std::string& base : {primitive, draco})
      add(Kind::kNumber, base + "/attributes", "POSITION _HU COLOR_0 NORMAL");
    add(Kind::kNumber, node, "mesh children/[] matrix/[] translation/[]");
    add(Kind::kNumber, node_trocar, "index z_mm mean_hu/[] surface lattice_bits distance_mm");
    add(Kind::kNumber, trocar, "schema lattice_bits slices hu_step materials/[]/label");
    add(Kind::kNumber, trocar + "/hu_volumes/[]",
        "version bufferView byteOffset byteLength planes origin_mm/[] pitch_mm/[] size/[] step_hu "
        "margin_steps");
    add(Kind::kNumber, parameters,
        "tolerance_mm min_angle_deg min_region_mm2 lattice_bits max_area_mm2 max_area_px2 grade_hu "
        "threshold equalize labels/[] joined_labels/[]/[] slices/[] crop/[] spacing_mm/[] close_mm "
        "min_volume_mm3 largest context_mm surface_triangles seeds_lps_mm/[]/[] mask_labels/[] "
        "volume");
    add(Kind::kFlag, "", "materials/[]/doubleSided accessors/[]/normalized");
    add(Kind::kFlag, parameters, "hu keep_table values_are_hu");
    for (const char* const path : {"/extensionsRequired/[]", "/extensionsUsed/[]"})
      add_choices(Kind::kText, path, "KHR_draco_mesh_compression KHR_materials_unlit");
    add_choices(Kind::kText, "/accessors/[]/type", "VEC3 SCALAR");
    add_choices(Kind::kText, "/asset/version", "2.0");
    add_choices(Kind::kText, parameters + "/contour", "subpixel pixel");
    add_choices(Kind::kText, parameters + "/simplify", "area dp");
    add_choices(Kind::kText, parameters + "/keep", "column");
    add_choices(Kind::kText, parameters + "/axis", "transverse coronal sagittal");
    add_choices(Kind::kText, parameters + "/completeness", "unknown");
    add_choices(Kind::kNumberOrText, parameters + "/fill_mm2", "all");
    add_text("/asset/generator", [](const std::string& text) {
      return matches(text, "trocar-mesh [0-9]{1,3}\\.[0-9]{1,3}\\.[0-9]{1,3}");
    });
    add(Kind::kName, "", "materials/[]/name extras/trocar/materials/[]/name");
    add_text("/extras/trocar/use", [](const std::string& text) { return text == kAssetUse; });
    add_text("/extras/trocar/input_key_digest",
             [](const std::string& text) { return matches(text, "[0-9a-f]{64}"); });
    add_text("/extras/trocar/parameters/modality",
             [](const std::string& text) { return shared_modality(text) == text; });
    return out;
  }();
  return all;
}

using LabelSet = std::set<std::int64_t>;

bool is_right(const json& value, const Allowed& allowed, const LabelSet& labels) {
  switch (allowed.kind) {
    case Kind::kNumber:
      return value.is_number();
    case Kind::kFlag:
      return value.is_boolean();
    case Kind::kObject:
      return value.is_object();
    case Kind::kList:
      return value.is_array();
    case Kind::kName:
      return value.is_string() && is_plain_name(value.get<std::string>(), labels);
    case Kind::kNumberOrText:
      if (value.is_number()) return true;
      [[fallthrough]];
    case Kind::kText:
      return value.is_string() && allowed.text(value.get<std::string>());
  }
  return false;
}

std::string shown(const json& value) {
  std::string text = json_text(value);
  constexpr std::size_t kMax = 60;
  if (text.size() > kMax) text = text.substr(0, kMax) + "...";
  return text;
}

// Depth is limited by parse_strict_json().
// NOLINTNEXTLINE(misc-no-recursion)
Result<void> check_json(const json& value, const std::string& path, const LabelSet& labels) {
  const auto allowed = allowed_values().find(path);
  if (allowed == allowed_values().end()) return refused("its JSON has " + path);
  if (!is_right(value, allowed->second, labels)) {
    const bool is_name = path.ends_with("/name") && value.is_string();
    return refused(
        "its JSON has " + path + " " + shown(value) +
        (is_name ? ", which is not made of words of anatomy; --names gives another" : ""));
  }
  for (const auto& [key, inner] : value.items()) {
    if (!value.is_structured()) break;
    if (auto ok = check_json(inner, path + '/' + (value.is_array() ? "[]" : key), labels); !ok)
      return ok;
  }
  return {};
}

// The labels from which the asset was made, which names may contain.
LabelSet labels_in(const json& document) {
  LabelSet out;
  const json::json_pointer where("/extras/trocar/parameters/labels");
  if (!document.is_object() || !document.contains(where)) return out;
  for (const json& label : document.at(where))
    if (label.is_number_integer()) out.insert(label.get<std::int64_t>());
  return out;
}

std::uint64_t unsigned_at(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number_unsigned() ? found->get<std::uint64_t>() : 0;
}

// Numbers of nodes, meshes, accessors and buffer views.
struct Used {
  std::set<std::uint64_t> nodes, meshes, accessors, views;
};

// The element of the document's list `key`, or an empty object.
json element(const json& document, const char* key, std::uint64_t number) {
  const auto list = document.find(key);
  return list != document.end() && list->is_array() && number < list->size()
             ? (*list)[static_cast<std::size_t>(number)]
             : json::object();
}

void use_primitive(const json& primitive, Used& used) {
  if (primitive.contains("indices")) used.accessors.insert(unsigned_at(primitive, "indices"));
  const json attributes = primitive.value("attributes", json::object());
  for (const auto& [name, accessor] : attributes.items())
    used.accessors.insert(unsigned_at(attributes, name.c_str()));
  const json extensions = primitive.value("extensions", json::object());
  if (const auto draco = extensions.find(kDracoExtension); draco != extensions.end())
    used.views.insert(unsigned_at(*draco, "bufferView"));
}

// The scenes and the volumes of HU refer to these elements, directly or not.
Used used_by_scenes(const json& document) {
  Used out;
  std::vector<std::uint64_t> waiting;
  const auto wait = [&waiting](const json& numbers) {
    for (const json& number : numbers)
      if (number.is_number_unsigned()) waiting.push_back(number.get<std::uint64_t>());
  };
  for (const json& scene : document.value("scenes", json::array()))
    wait(scene.value("nodes", json::array()));
  const json nodes = document.value("nodes", json::array());
  while (!waiting.empty()) {
    const std::uint64_t number = waiting.back();
    waiting.pop_back();
    if (number >= nodes.size() || !out.nodes.insert(number).second) continue;
    const json& node = nodes[static_cast<std::size_t>(number)];
    if (node.contains("mesh")) out.meshes.insert(unsigned_at(node, "mesh"));
    wait(node.value("children", json::array()));
  }
  for (const std::uint64_t mesh : out.meshes)
    for (const json& primitive :
         element(document, "meshes", mesh).value("primitives", json::array()))
      use_primitive(primitive, out);
  for (const std::uint64_t number : out.accessors) {
    const json accessor = element(document, "accessors", number);
    if (accessor.contains("bufferView")) out.views.insert(unsigned_at(accessor, "bufferView"));
  }
  for (const json& volume : document.at("extras").at("trocar").value("hu_volumes", json::array()))
    out.views.insert(unsigned_at(volume, "bufferView"));
  return out;
}

// Refuses nodes, meshes, accessors and buffer views that no scene and no volume of HU uses: a
// viewer does not show them, so their bytes could be anything.
Result<void> check_all_used(const json& document) {
  const Used used = used_by_scenes(document);
  const std::tuple<const char*, const char*, const std::set<std::uint64_t>&> lists[] = {
      {"nodes", "node", used.nodes},
      {"meshes", "mesh", used.meshes},
      {"accessors", "accessor", used.accessors},
      {"bufferViews", "buffer view", used.views}};
  for (const auto& [key, name, numbers] : lists) {
    const std::size_t count = document.value(key, json::array()).size();
    for (std::size_t number = 0; number < count; ++number)
      if (!numbers.contains(number))
        return refused(std::string(name) + " " + std::to_string(number) + " is not used");
  }
  return {};
}

Result<void> check_binary(std::span<const std::uint8_t> binary, std::uint64_t index_bytes,
                          const json& document) {
  std::vector<std::pair<std::uint64_t, std::uint64_t>> covered{{0, index_bytes}};
  for (const json& view : document.value("bufferViews", json::array())) {
    const std::uint64_t offset = unsigned_at(view, "byteOffset");
    covered.emplace_back(offset, offset + unsigned_at(view, "byteLength"));
  }
  covered.emplace_back(binary.size(), binary.size());
  std::sort(covered.begin(), covered.end());
  std::uint64_t end = 0;
  for (const auto& [from, to] : covered) {
    if (from > end) {
      const auto gap = binary.subspan(
          static_cast<std::size_t>(end),
          static_cast<std::size_t>(std::min<std::uint64_t>(from - end, binary.size() - end)));
      if (gap.size() > 3 || std::any_of(gap.begin(), gap.end(), [](auto b) { return b != 0; }))
        return refused(std::to_string(gap.size()) + " bytes of its binary data from " +
                       std::to_string(end) + " on do not belong to any content");
    }
    end = std::min<std::uint64_t>(std::max(end, to), binary.size());
  }
  return {};
}

// The words that names of materials consist of, each between blanks: those of the tables of VerSe
// and TotalSegmentator, and others of anatomy, of implants and of place.
constexpr std::string_view kAnatomicalWords =
    " abdomen abdominal accessory acetabulum adrenal air airway all alveolar and aneurysm"
    " ankle annulus anterior aorta appendage arch arteries artery articular ascending atlas"
    " atria atrial atrium autochthon axial axis background basal bladder blood bodies body"
    " bone bones bowel brachiocephalic brain brainstem breast bronchi bronchus calcaneus"
    " calcification callus canal canine capitate cardiac carotid cartilage cartilages cava"
    " cavity cement cerebellum cervical cheek chest clavicle clavicula coccyx colon column"
    " common condyle contrast cord coronal coronary coronoid cortex cortical costal cranial"
    " cranium cricoid crown ct cuboid cuneiform cyst deltoid dens dental dermis descending"
    " device diaphragm disc discs disk disks distal dorsal duodenum ear edema elbow electrode"
    " enamel endplate epidural epiphysis esophagus ethmoid external eye eyes face facet facial"
    " fascia fat femoral femur fibula fifth finger fingers first flavum fluid foot foramen"
    " foramina forearm foreign fourth fracture fragment frontal gallbladder gland glands"
    " glenoid gluteus graft growth hamate hand head heart hematoma hepatic hip hole humerus"
    " hyoid iliac iliopsoas ilium implant incisor inferior inner insert inside internal"
    " interspinous intervertebral ischium jaw joint joints kidney kidneys knee label labels"
    " lacrimal lamina laminae large larynx lateral left leg lens lesion ligament ligaments"
    " ligamentum limb lingual lip liver lobe longus low lower lumbar lumen lunate lung lungs"
    " lymph magnum main malleolus mandible mandibular manubrium marrow mask mass mastoid"
    " material maxilla maxillary maximus medial medius medulla meninges meniscus metacarpal"
    " metacarpals metal metatarsal metatarsals middle minimus mitral molar more mouth muscle"
    " muscles myocardium nail nasal navicular neck needle nerve nerves node nodule nose"
    " nucleus object occipital occiput oesophagus of optic oral orbit organ organs outer"
    " outline outlines outside ovary palate palatine pancreas parietal parotid part patella"
    " pedicle pedicles pelvic pelvis periosteum petrous phalanges phalanx pharynx pisiform"
    " plate portal posterior premolar process processes prostate proximal psoas pubis"
    " pulmonary pulp radius ramus region renal rest retina rib ribs right rod root roots"
    " sacral sacroiliac sacrum sagittal scalp scaphoid scapula scapulae screw second segment"
    " segmentation sella septum seventh shaft shoulder sinus sinuses sixth skeleton skin skull"
    " small soft solid space spacer spacers specimen sphenoid spinal spine spines spinosus"
    " spinous spleen splenic stem stent sternal sternum stomach structure structures"
    " subclavian subcutaneous superior supraspinatus surface surfaces suture talus tarsal"
    " teeth temporal tendon testis the thick thigh thin third thoracic thorax throat thumb"
    " thymus thyroid tibia tissue tissues toe toes tongue tonsil tooth total trabecular"
    " trachea transverse transversus trapezium trapezius trapezoid triquetrum trochanter trunk"
    " tumor tumour turbinate tympanic ulna unknown upper ureter urethra urinary uterus valve"
    " vasculature vein veins vena ventral ventricle ventricles vertebra vertebrae vertebral"
    " vessel vessels vestibule void volume vomer wall whole wisdom with without wrist xiphoid"
    " zygapophyseal zygoma zygomatic ";

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

bool is_letter(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}

// A level of the spine, in lower case: C1 to C8, T1 to T13, L1 to L6, S1 to S5.
bool is_level(const std::string& token) {
  return matches(token, "c[1-8]|t[1-9]|t1[0-3]|l[1-6]|s[1-5]");
}

bool is_known_word(const std::string& word) {
  return word.size() >= 2 && kAnatomicalWords.find(' ' + word + ' ') != std::string_view::npos;
}

// Judges a name token by token. A token is a run of letters and digits, in lower case.
class NameJudge {
 public:
  explicit NameJudge(const std::set<std::int64_t>& labels) : labels_(labels) {}

  bool accepts(const std::string& token) {
    const auto letters = static_cast<std::size_t>(
        std::find_if(token.begin(), token.end(), is_digit) - token.begin());
    const std::string word = token.substr(0, letters), number = token.substr(letters);
    if (!std::all_of(number.begin(), number.end(), is_digit)) return false;
    if (is_level(token)) return true;
    if (letters == 1)
      return number.empty() && (word == "l" || word == "r") && !std::exchange(has_side_, true);
    if (letters > 0 && !is_known_word(word)) return false;
    is_rib_ |= word == "rib" || word == "ribs";
    if (!number.empty() && !is_ordinal_of_rib(number) && !is_label(number))
      digits_ += number.size();
    return digits_ <= 4;
  }
  // A plus sign joins the names of several labels.
  void join() { has_side_ = is_rib_ = false; }

 private:
  bool is_ordinal_of_rib(const std::string& number) const {
    return is_rib_ && matches(number, "[1-9]|1[0-3]");
  }
  bool is_label(const std::string& number) const {
    return number.size() <= 10 && number.front() != '0' && labels_.contains(std::stoll(number));
  }

  const std::set<std::int64_t>& labels_;
  std::size_t digits_ = 0;
  bool has_side_ = false, is_rib_ = false;
};

}  // namespace

bool is_modality(std::string_view text) {
  return is_any_of(text, {"BI",  "BMD",   "CR",   "CT", "DG", "DMS", "DX", "ES",     "GM",
                          "IO",  "IVOCT", "IVUS", "LS", "MG", "MR",  "NM", "OCT",    "OP",
                          "OPM", "OPT",   "OT",   "PT", "PX", "RF",  "RG", "RTDOSE", "RTIMAGE",
                          "SC",  "SEG",   "SM",   "ST", "TG", "US",  "XA", "XC"});
}

std::string shared_modality(std::string_view text) {
  const std::size_t space = std::min(text.find(' '), text.size());
  const bool is_known =
      is_modality(text.substr(0, space)) &&
      (space == text.size() ||
       is_any_of(text.substr(space + 1),
                 {"LOCALIZER", "SCOUT", "SURVIEW", "REF_SURVIEW", "MOSAIC", "SECONDARY CAPTURE",
                  "OD", "ED", "EDW", "MGML", "PCT", "Z_EFF"}));
  return is_known ? std::string(text) : "OT";
}

bool is_plain_name(std::string_view name, const std::set<std::int64_t>& labels) {
  NameJudge judge(labels);
  std::string token;
  for (std::size_t i = 0; i <= name.size(); ++i) {
    const char c = i < name.size() ? name[i] : ' ';
    if (is_letter(c) || is_digit(c)) {
      token += c >= 'A' && c <= 'Z' ? static_cast<char>(c + ('a' - 'A')) : c;
      continue;
    }
    if (std::string_view(" _-+,/()").find(c) == std::string_view::npos) return false;
    if (!token.empty() && !judge.accepts(token)) return false;
    token.clear();
    if (c == '+') judge.join();
  }
  return !name.empty() && name.size() <= 64;
}

Result<void> check_deidentified_asset(std::span<const std::uint8_t> glb, const std::string& name) {
  const auto found = [&name](const std::string& what) {
    return refused(name + ": not de-identified: " + what);
  };
  MemorySource source(glb);
  const auto json_bytes = json_bytes_of(source);
  if (!json_bytes) return refused(name + ": " + json_bytes.error().message);
  const auto index = find_index(source);
  if (!index) return refused(name + ": " + index.error().message);
  if (!*index) return found("it has no slice index, or chunks beside those of an asset");
  const std::string_view text(reinterpret_cast<const char*>(glb.data()) + kGlbHeader, *json_bytes);
  const std::size_t end = text.find_last_not_of(' ') + 1;
  const auto document = parse_strict_json(text, name);
  if (!document) return document.error();
  if (text.size() - end > 3 || json_text(*document).size() != end)
    return found("its JSON text has more characters than its contents need");
  if (auto ok = check_json(*document, "", labels_in(*document)); !ok)
    return found(ok.error().message);
  for (const json& volume :
       document->at("extras").at("trocar").value("hu_volumes", json::array())) {
    if (!volume.contains("margin_steps"))
      return found(
          "it holds HU of everything around its material, which can show a face; make it again "
          "without --context");
  }
  if (auto ok = check_all_used(*document); !ok) return found(ok.error().message);
  if (auto ok = check_binary(glb.subspan((*index)->binary_at), (*index)->bytes(), *document); !ok)
    return found(ok.error().message);
  return {};
}

}  // namespace trocar
