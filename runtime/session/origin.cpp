// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/origin.h"

#include <sodium.h>

namespace trocar::runtime {
namespace {

constexpr const char* kRate = "rate_Hz";
constexpr const char* kDuration = "duration_s";
constexpr const char* kMargin = "stiffness-margin";
constexpr const char* kStateGap = "state-gap";
constexpr const char* kNoDataLimit = "no-data-limit";

const char* name_of(const CompensationOptions& options) {
  if (options.friction) return options.gravity ? "both" : "friction";
  return options.gravity ? "weight" : "none";
}

}  // namespace

Result<std::string> digest_of(const std::filesystem::path& file) {
  constexpr std::uint64_t kBlock = std::uint64_t{1} << 20;
  if (::sodium_init() < 0) return bug("libsodium cannot be initialised");
  const Result<std::unique_ptr<ByteSource>> source = open_file(file);
  if (!source) return source.error();
  crypto_generichash_state state;
  ::crypto_generichash_init(&state, nullptr, 0, crypto_generichash_BYTES);
  std::vector<std::uint8_t> block;
  for (std::uint64_t at = 0; at < (*source)->size(); at += block.size()) {
    block.resize(std::min(kBlock, (*source)->size() - at));
    if (const Result<void> read = (*source)->read(at, block); !read) return read.error();
    ::crypto_generichash_update(&state, block.data(), block.size());
  }
  std::array<unsigned char, crypto_generichash_BYTES> hash;
  ::crypto_generichash_final(&state, hash.data(), hash.size());
  std::array<char, 2 * hash.size() + 1> hex;
  return std::string(::sodium_bin2hex(hex.data(), hex.size(), hash.data(), hash.size()));
}

Result<RecordingOrigin> make_origin(const std::filesystem::path& scene_file, const Scene& scene,
                                    const DeviceDescription& description,
                                    const SessionOptions& options) {
  const Result<std::string> scene_digest = digest_of(scene_file);
  if (!scene_digest) return scene_digest.error();
  const Result<std::string> asset_digest = digest_of(scene.asset);
  if (!asset_digest) return asset_digest.error();
  std::string device = "built-in";
  if (scene.device && description != default_device_description()) {
    if (const auto ok = digest_of(*scene.device).into(device); !ok) return ok.error();
  }
  RecordingOrigin origin;
  origin.entries = {
      {kOriginProgram, TROCAR_VERSION},
      {kOriginScene, *scene_digest},
      {kOriginAsset, *asset_digest},
      {kOriginDevice, device},
      {kRate, origin_number(options.rate_Hz)},
      {"force-law", std::string(to_string(scene.force_law.kind))},
      {"passivity", options.guards ? "on" : "off"},
      {"coupling",
       options.coupling.on ? origin_number(options.coupling.stiffness_N_per_m) : "none"},
      {"compensate", name_of(options.compensation)},
      {"energy-limit", origin_number(options.limits.energy_limit_J)}};
  if (options.duration_s != scene.duration_s)
    origin.entries.emplace_back(kDuration, origin_number(options.duration_s));
  if (options.limits.gap_max_s == 0) origin.entries.emplace_back(kStateGap, "any");
  if (options.limits.no_data_max_s != SafetyLimits{}.no_data_max_s)
    origin.entries.emplace_back(kNoDataLimit, origin_number(options.limits.no_data_max_s));
  if (options.counts_xray) origin.entries.emplace_back(kOriginXray, "counted");
  // Only the force law that renders such a stiffness has these entries, and only if they are not the default.
  if (!traits_of(scene.force_law.kind).uses_bone_volume) return origin;
  if (options.stiffness.margin != 1)
    origin.entries.emplace_back(kMargin, origin_number(options.stiffness.margin));
  if (std::isfinite(options.stiffness.max_N_per_m))
    origin.entries.emplace_back("stiffness-limit", origin_number(options.stiffness.max_N_per_m));
  return origin;
}

void set_stated_limits(const RecordingOrigin& recorded, SessionOptions& options) {
  const std::string* const margin = recorded.find(kMargin);
  options.stiffness.margin =
      margin != nullptr && *margin == origin_number(kHardwareMargin) ? kHardwareMargin : 1;
  if (recorded.find(kStateGap) != nullptr) {
    options.limits.gap_max_s = 0;
    options.limits.state_gap_max_s = std::numeric_limits<double>::infinity();
  }
  const double usual_s = SafetyLimits{}.no_data_max_s;
  const double stated_s = recorded.number(kNoDataLimit).value_or(usual_s);
  options.limits.no_data_max_s = stated_s >= usual_s && stated_s <= 1 ? stated_s : usual_s;
}

double stated_rate_Hz(const RecordingOrigin& recorded) {
  return recorded.number(kRate).value_or(0);
}

double stated_duration_s(const RecordingOrigin& recorded, const Scene& scene) {
  const double stated_s = recorded.number(kDuration).value_or(scene.duration_s);
  return stated_s > 0 && stated_s <= kMaxDuration_s ? stated_s : scene.duration_s;
}

Result<std::string> check_replay(const RecordingOrigin& recorded, const RecordingOrigin& run,
                                 const std::string& name) {
  if (recorded.entries.empty()) return refused(name + ": does not say what it was recorded with");
  if (const std::string what = differences(recorded, run); !what.empty()) {
    return refused(name + ": was recorded with other inputs: " + what +
                   "; give those that it was recorded with");
  }
  const std::string* const program = recorded.find(kOriginProgram);
  if (program != nullptr && *program == TROCAR_VERSION) return std::string();
  return name + ": was recorded by version " + (program != nullptr ? *program : "unknown") +
         ", this is " TROCAR_VERSION "; torques that differ are an error all the same";
}

}  // namespace trocar::runtime
