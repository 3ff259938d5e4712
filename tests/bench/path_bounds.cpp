// SPDX-License-Identifier: GPL-3.0-or-later
// path_bounds < PLAN.json > ROWS.json: each stage of trocar-mesh, from files to an asset, beside
// the least time that it could take on this machine: its bytes at memory bandwidth, or what the
// library behind it takes alone.
//
// PLAN: {"repetitions": 5, "inputs": [{"id", "path", "threshold",
//        "spacing_mm": [x, y, z] (of images)}, ..]}
// One thread; files in the page cache; medians. Repetitions of a run and of its bounds alternate.
#include <draco/compression/decode.h>
#include <sodium.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/draco_mesh.h"
#include "formats/asset/draco_settings.h"
#include "formats/base/file_io.h"
#include "pipeline/base/stopwatch.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/read/image/png_chunks.h"
#include "pipeline/read/isal.h"
#include "pipeline/scan/mesh_stack.h"
#include "tests/bench/sweep_main.h"

namespace {

using namespace trocar;
using namespace trocar::pipeline;
using nlohmann::json;
using Bytes = std::vector<std::uint8_t>;

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

struct Input {
  std::string id;
  std::filesystem::path path;
  double threshold = 0;
  std::optional<std::array<double, 3>> spacing_mm;
};

struct Run {
  StackResult batch;
  std::vector<std::filesystem::path> files;  // of the input
  double pixels = 0;                         // of all slices
};

Result<Run> run_once(const Input& input) {
  StackOptions options;
  options.start = std::chrono::steady_clock::now();
  options.mesh.segmentation = Threshold{input.threshold};
  options.threads = 1;
  options.input_key.assign(32, 1);
  OpenOptions open;
  open.spacing_mm = input.spacing_mm;
  open.unpack_behind = true;
  const auto stack = open_stack({input.path}, open);
  if (!stack) return stack.error();
  auto batch = mesh_stack(**stack, options, {});
  if (!batch) return batch.error();
  return Run{std::move(*batch), (*stack)->files,
             static_cast<double>((*stack)->size()) * (*stack)->width() * (*stack)->height()};
}

// The compressed part of a file: all of a gzip, the IDAT chunks of a PNG, nothing of another.
struct Packed {
  Bytes bytes;
  std::uint32_t format = ISAL_GZIP;
};
Packed packed_part(const Bytes& file) {
  constexpr std::array<std::uint8_t, 2> kGzip{0x1f, 0x8b};
  constexpr std::array<std::uint8_t, 4> kPng{0x89, 'P', 'N', 'G'};
  if (file.size() > 2 && std::equal(kGzip.begin(), kGzip.end(), file.begin())) return {file};
  Packed out{{}, ISAL_ZLIB};
  if (file.size() < 8 || !std::equal(kPng.begin(), kPng.end(), file.begin())) return out;
  for (PngChunks chunks(file); chunks.next();) {
    if (chunks.is("IDAT"))
      out.bytes.insert(out.bytes.end(), chunks.data().begin(), chunks.data().end());
  }
  return out;
}

// The bytes that come out of it.
std::uint64_t inflate(const Packed& packed, Bytes& buffer) {
  if (packed.bytes.empty()) return 0;
  inflate_state state;
  isal_inflate_init(&state);
  state.crc_flag = packed.format;
  state.next_in = const_cast<std::uint8_t*>(packed.bytes.data());
  state.avail_in = static_cast<std::uint32_t>(packed.bytes.size());
  std::uint64_t out = 0;
  while (state.block_state != ISAL_BLOCK_FINISH) {
    state.next_out = buffer.data();
    state.avail_out = static_cast<std::uint32_t>(buffer.size());
    const std::uint32_t left = state.avail_in;
    if (inflate_on(state) != ISAL_DECOMP_OK) break;
    out += buffer.size() - state.avail_out;
    if (state.avail_in == left && state.avail_out == buffer.size()) break;
  }
  return out;
}

// The meshes of an asset as Draco has them, to be compressed again as encode_draco() does.
class DracoAlone {
 public:
  static Result<DracoAlone> of(const Bytes& glb) {
    const auto asset = decode_asset(glb, "the asset");
    if (!asset) return asset.error();
    DracoAlone out;
    std::vector<LatticePoint> all;
    for (const AssetSlice& slice : asset->slices)
      all.insert(all.end(), slice.mesh.vertices.begin(), slice.mesh.vertices.end());
    if (all.empty()) return refused("no triangles");
    const auto grid = asset_grid(asset->lattice, box_around(all));
    if (!grid) return grid.error();
    out.grid_ = *grid;
    for (const AssetSlice& slice : asset->slices) {
      if (slice.mesh.triangles.empty()) continue;
      const auto payload = encode_draco(slice.mesh, *grid, slice.hu);
      if (!payload) return payload.error();
      out.payload_bytes_ += payload->size();
      draco::DecoderBuffer buffer;
      buffer.Init(reinterpret_cast<const char*>(payload->data()), payload->size());
      draco::Decoder decoder;
      auto mesh = decoder.DecodeMeshFromBuffer(&buffer);
      if (!mesh.ok()) return bug("Draco: " + mesh.status().error_msg_string());
      out.meshes_.push_back(std::move(mesh).value());
    }
    return out;
  }

  std::uint64_t payload_bytes() const { return payload_bytes_; }

  // The bytes that it gives.
  Result<std::uint64_t> encode() const {
    std::uint64_t out = 0;
    for (const auto& mesh : meshes_) {
      draco::ExpertEncoder encoder(*mesh);
      draco::Status ok = configure(encoder, *mesh, grid_);
      draco::EncoderBuffer buffer;
      if (ok.ok()) ok = encoder.EncodeToBuffer(&buffer);
      if (!ok.ok()) return bug("Draco: " + ok.error_msg_string());
      out += buffer.size();
    }
    return out;
  }

 private:
  DracoGrid grid_;
  std::vector<std::unique_ptr<draco::Mesh>> meshes_;
  std::uint64_t payload_bytes_ = 0;
};

// Bytes read and written in a ms.
double copied_bytes_per_ms(int repetitions) {
  constexpr std::size_t kBytes = std::size_t{1} << 27;  // beyond any cache
  Bytes from(kBytes, 1), to(kBytes);
  std::vector<double> ms;
  for (int i = 0; i < repetitions; ++i) {
    Stopwatch watch;
    std::memcpy(to.data(), from.data(), kBytes);
    ms.push_back(watch.lap_ms());
    from[static_cast<std::size_t>(i)] = to[kBytes - 1];
  }
  return 2 * kBytes / median(ms);
}

// The sum of a figure over the report's slices that have a mesh.
double sum_of(const json& report, const char* figure) {
  double sum = 0;
  for (const json& slice : report["slices"])
    sum += slice.value(figure, 0.0);
  return sum;
}

struct Bound {
  const char* by;
  double ms;
};

Result<json> measured(const Input& input, int repetitions, double bytes_per_ms) {
  std::map<std::string, std::vector<double>> stages_ms;
  std::vector<double> total_ms, inflate_ms, digest_ms, draco_ms;
  std::optional<Run> run;
  std::vector<Bytes> files;
  std::vector<Packed> packed;
  std::uint64_t inflated = 0, draco_bytes = 0, payload_bytes = 0;
  for (int i = 0; i < repetitions; ++i) {
    auto made = run_once(input);
    if (!made) return made.error();
    run = std::move(*made);
    const json& report = run->batch.report;
    total_ms.push_back(report["total_ms"]);
    for (const auto& [stage, ms] : report["stages_ms"].items())
      stages_ms[stage].push_back(ms);

    for (; files.size() < run->files.size(); packed.push_back(packed_part(files.back()))) {
      auto bytes = read_file(run->files[files.size()]);
      if (!bytes) return bytes.error();
      files.push_back(std::move(*bytes));
    }
    Bytes buffer(1 << 20);
    Stopwatch watch;
    inflated = 0;
    for (const Packed& part : packed)
      inflated += inflate(part, buffer);
    inflate_ms.push_back(watch.lap_ms());

    std::array<std::uint8_t, crypto_generichash_BYTES> hash{};
    for (const Bytes& file : files)
      crypto_generichash(hash.data(), hash.size(), file.data(), file.size(), nullptr, 0);
    digest_ms.push_back(watch.lap_ms());

    const auto draco = DracoAlone::of(run->batch.glb);
    if (!draco) return draco.error();
    payload_bytes = draco->payload_bytes();
    watch.lap_ms();
    const auto bytes = draco->encode();
    if (!bytes) return bytes.error();
    draco_bytes = *bytes;
    draco_ms.push_back(watch.lap_ms());
  }

  const json& report = run->batch.report;
  double input_bytes = 0;
  for (const Bytes& file : files)
    input_bytes += static_cast<double>(file.size());
  const bool is_gzip = packed.front().format == ISAL_GZIP;
  const double pixel_bytes = sizeof(float) * run->pixels,
               voxel_bytes = is_gzip ? static_cast<double>(inflated) : input_bytes,
               contour_bytes = sizeof(LatticePoint) * sum_of(report, "contour_vertices"),
               outline_bytes = sizeof(LatticePoint) * sum_of(report, "pslg_vertices"),
               triangles = sum_of(report, "triangles"), vertices = sum_of(report, "vertices"),
               mesh_bytes = sizeof(Triangle) * triangles + sizeof(LatticePoint) * vertices,
               asset_bytes = static_cast<double>(run->batch.glb.size());
  const double hu_bytes = report["asset"].value("hu_bytes", 0.0);
  const bool has_hu = hu_bytes > 0;
  const auto moved = [&](double bytes) { return Bound{"memory", bytes / bytes_per_ms}; };
  const auto bound = [&](const std::string& stage) -> std::optional<Bound> {
    if (stage == "unpack" && is_gzip) return Bound{"inflate", median(inflate_ms)};
    if (stage == "read" && inflated > 0 && !is_gzip)
      return Bound{"inflate and memory",
                   median(inflate_ms) + moved(static_cast<double>(inflated) + pixel_bytes).ms};
    if (stage == "read") return moved(voxel_bytes + pixel_bytes);
    // Without HU no mean is taken here; the threshold belongs to `contour`.
    if (stage == "segment" && has_hu) return moved(pixel_bytes);
    if (stage == "contour") return moved(pixel_bytes + contour_bytes);
    if (stage == "simplify") return moved(contour_bytes + outline_bytes);
    if (stage == "triangulate") return moved(outline_bytes + sizeof(Triangle) * triangles);
    if (stage == "refine" || stage == "check") return moved(mesh_bytes);
    if (stage == "hu" && has_hu) return moved(hu_bytes);
    if (stage == "encode") return Bound{"Draco", median(draco_ms)};
    if (stage == "digest") return Bound{"BLAKE2b", median(digest_ms)};
    if (stage == "assemble") return moved(2 * asset_bytes);
    return std::nullopt;
  };
  json stages = json::array();
  for (const auto& [stage, ms] : stages_ms) {
    json row = {{"id", stage}, {"ms", median(ms)}};
    if (const auto least = bound(stage)) {
      row["bound_ms"] = least->ms;
      row["bound"] = least->by;
    }
    stages.push_back(std::move(row));
  }
  return json{{"id", input.id},
              {"slices", report["slices"].size()},
              {"pixels", run->pixels},
              {"triangles", triangles},
              {"input_bytes", input_bytes},
              {"inflated_bytes", inflated},
              {"asset_bytes", asset_bytes},
              {"payload_bytes", payload_bytes},
              {"draco_alone_bytes", draco_bytes},
              {"total_ms", median(total_ms)},
              {"stages", std::move(stages)}};
}

Result<json> run(const json& plan) {
  const int repetitions = plan.at("repetitions");
  if (repetitions < 1) return usage("repetitions must be >= 1");
  if (sodium_init() < 0) return bug("libsodium does not initialise");
  const double bytes_per_ms = copied_bytes_per_ms(std::max(repetitions, 5));
  json rows = json::array();
  for (const json& wanted : plan.at("inputs")) {
    Input input{wanted.at("id"), wanted.at("path").get<std::string>(), wanted.at("threshold"), {}};
    if (wanted.contains("spacing_mm")) input.spacing_mm = wanted["spacing_mm"];
    auto row = measured(input, repetitions, bytes_per_ms);
    if (!row) return row.error();
    rows.push_back(std::move(*row));
  }
  return json{{"copied_GB_per_s", bytes_per_ms / 1e6}, {"rows", std::move(rows)}};
}

}  // namespace

int main() {
  return trocar::test::sweep_main("path_bounds", run);
}
