// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/session_body.h"

#include <algorithm>
#include <utility>

#include "runtime/session/scene_needs.h"
#include "runtime/session/text_line.h"

namespace trocar::runtime {

Result<SessionBody> make_session_body(const Scene& scene, const DeviceDescription& device,
                                      std::span<const Sheet* const> sheets, double rate_Hz) {
  Result<Body> body = make_body(scene, sheets);
  if (!body) return Error{body.error().code, scene.asset.string() + ": " + body.error().message};
  SessionBody out;
  out.coupling = choose_coupling(*body, scene.force_law, device,
                                 over_anchor(*sheets.front(), body->tool), rate_Hz);
  body->options.coupling = out.coupling.coupling;
  out.body = std::make_shared<const Body>(std::move(*body));
  return out;
}

std::string describe(const Scene& scene, const SessionBody& body,
                     std::span<const Sheet* const> sheets) {
  const Body& b = *body.body;
  const auto joined = static_cast<std::size_t>(
      std::count_if(b.sheets.begin(), b.sheets.end(),
                    [](const BodySheet& each) { return each.bottom_m > each.top_m; }));
  std::string out = text_line(
      "body       %zu slices as %zu slabs of one body, %zu as shells of no "
      "thickness\n",
      joined, b.slabs.size() - (b.sheets.size() - joined), b.sheets.size() - joined);
  if (b.shell_m > 0) out += text_line("           cortical shell of %.3g mm\n", 1e3 * b.shell_m);
  out += "coupling   " + describe(body.coupling, scene.force_law) + '\n';
  const auto by_hu = std::find_if(b.sheets.begin(), b.sheets.end(),
                                  [](const BodySheet& each) { return each.law != nullptr; });
  if (by_hu != b.sheets.end()) {
    const HuCalibration& c = by_hu->calibration;
    out += text_line("bone       law %.*s; %.*s = %.4g + %.4g HU g/cm^3%s\n",
                     static_cast<int>(by_hu->law->name.size()), by_hu->law->name.data(),
                     static_cast<int>(name_of(c.kind).size()), name_of(c.kind).data(), c.at_0_HU,
                     c.per_HU, c.is_assumed ? ", assumed: the scene does not give it" : "");
  }
  if (std::any_of(sheets.begin(), sheets.end(),
                  [](const Sheet* sheet) { return sheet->tissue.damping_N_s_per_m > 0; }))
    out += "           the tissue's damping_N_s_per_m is not used by this law\n";
  return out;
}

}  // namespace trocar::runtime
