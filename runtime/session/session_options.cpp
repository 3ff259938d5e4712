// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/session_options.h"

#include "formats/base/text.h"

namespace trocar::runtime {

std::uint64_t tick_count(double duration_s, double rate_Hz) {
  // Rounding must not add a tick to a duration of whole periods.
  const double ticks = duration_s * rate_Hz;
  const double nearest = std::round(ticks);
  return static_cast<std::uint64_t>(
      std::max(1.0, std::abs(ticks - nearest) < 1e-6 ? nearest : std::ceil(ticks)));
}

Result<double> recorded_rate_Hz(std::span<const RecordingRow> rows, const std::string& name,
                                double stated_Hz) {
  if (rows.size() < 2) return refused(name + ": a single row has no rate");
  if (rows.front().t_s != 0) {
    return refused(name +
                   ": does not begin at the start of its session, like the black box of a longer "
                   "one; it cannot be replayed");
  }
  const double exact = static_cast<double>(rows.size() - 1) / rows.back().t_s;
  if (!(exact >= kMinRate_Hz * (1 - 1e-12) && exact <= kMaxRate_Hz * (1 + 1e-12)))
    return refused(name + ": its rate is outside the range of the loop");
  // Users set rates as short decimals, so the shortest decimal that gives the time of every row is
  // used. `exact` may differ by a few rounding errors.
  std::size_t max_rows = 0;  // largest number of rows whose times a candidate has matched
  const auto fits = [&](double rate_Hz) {
    std::size_t k = 0;
    while (k < rows.size() && rows[k].t_s == static_cast<double>(k) / rate_Hz)
      ++k;
    max_rows = std::max(max_rows, k);
    return k == rows.size() && rate_Hz >= kMinRate_Hz && rate_Hz <= kMaxRate_Hz;
  };
  if (fits(stated_Hz)) return stated_Hz;
  for (int digits = 1; digits <= std::numeric_limits<double>::max_digits10; ++digits) {
    const double rate_Hz = std::strtod(text_line("%.*g", digits, exact).c_str(), nullptr);
    if (fits(rate_Hz)) return rate_Hz;
  }
  double below = exact, above = exact;
  for (int i = 0; i < 4; ++i) {
    below = std::nextafter(below, 0);
    above = std::nextafter(above, std::numeric_limits<double>::infinity());
    if (fits(below)) return below;
    if (fits(above)) return above;
  }
  return refused(name + ": row " + std::to_string(max_rows + 1) +
                 " has an unexpected time: no rate gives the times of all rows to the last bit");
}

}  // namespace trocar::runtime
