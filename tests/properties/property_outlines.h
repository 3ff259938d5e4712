// SPDX-License-Identifier: GPL-3.0-or-later
// Random outlines for properties. All kinds are equally frequent at every rapidcheck size, so that
// degenerate cases are frequent by design.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "pipeline/contour/contour.h"
#include "tests/cases/pslg_case.h"
#include "tests/properties/property_fixture.h"
#include "tests/support/random_geometry.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/test_lattice.h"

namespace trocar::test {

using runtime::Random;

enum class OutlineKind : std::uint8_t {
  kContours,        ///< sub-pixel contours of noise: islands, holes, necks
  kChains,          ///< pixel chains of noise: pinches
  kStars,           ///< stars with holes
  kSpecks,          ///< specks in a star's bays, where a simplified edge may pass over them
  kNeedles,         ///< angles down to a thousandth of a degree in one corner
  kNearCoincident,  ///< vertices one step apart, slits one step wide
  kCocircular,      ///< corners of rings exactly on concentric circles
  kCorpus,          ///< a stress case of tests/corpus/pslg
};
inline constexpr int kOutlineKinds = 8;

/// A star with up to three holes.
inline Pslg any_star(Random& random, int radius) {
  for (;;) {
    Pslg out{{runtime::star(random, {}, 0.5 * radius, radius, random.between(3, 30))}};
    for (int holes = random.between(0, 3); holes > 0; --holes) {
      Ring hole = runtime::star(random, random.point(-radius / 3, radius / 3), 0.03 * radius,
                                0.15 * radius, random.between(3, 9));
      std::reverse(hole.begin(), hole.end());
      out.rings.push_back(hole);
    }
    if (check_pslg(out)) return out;
  }
}

/// Adds the ring if the outline stays valid.
inline void add_if_valid(Pslg& pslg, const Ring& ring) {
  pslg.rings.push_back(ring);
  if (!check_pslg(pslg)) pslg.rings.pop_back();
}

inline Pslg any_specks(Random& random, int radius) {
  Pslg out = any_star(random, radius);
  for (int specks = random.between(1, 12); specks > 0; --specks)
    add_if_valid(out, runtime::star(random, random.point(-radius, radius), 2, 12, 3));
  return out;
}

/// Up to four needles with their tips in one corner.
inline Pslg any_needles(Random& random) {
  Pslg out;
  const int length = random.between(200, 60'000);
  std::int32_t y = random.between(-1000, 1000);
  for (int needles = random.between(1, 4); needles > 0; --needles) {
    const int width = random.between(0, 1) == 0 ? random.between(1, 5) : random.between(1, 500);
    out.rings.push_back({{0, 0}, {length, y}, {length, y + width}});
    y += width + random.between(1, 3000);
  }
  return out;
}

inline Pslg any_near_coincident(Random& random, int radius) {
  Pslg out = any_star(random, radius);
  for (int pairs = random.between(2, 6); pairs > 0; --pairs) {
    Pslg next = out;
    Ring& ring = next.rings[0];
    const auto i = static_cast<std::size_t>(random.between(0, static_cast<int>(ring.size()) - 1));
    const LatticePoint off = random.point(-1, 1);
    ring.insert(ring.begin() + static_cast<std::ptrdiff_t>(i),
                {ring[i].x + off.x, ring[i].y + off.y});
    if (check_pslg(next)) out = next;
  }
  for (int slits = random.between(1, 3); slits > 0; --slits) {
    const LatticePoint p = random.point(-radius / 2, 0),
                       q{p.x + random.between(20, radius), p.y + random.between(0, radius / 4)};
    add_if_valid(out, {p, {p.x, p.y + 1}, {q.x, q.y + 1}, q});
  }
  return out;
}

inline Ring any_ring_on_a_circle(Random& random, int radius2, int scale) {
  std::vector<LatticePoint> all;
  for (int x = 0; x * x <= radius2; ++x) {
    for (int y = 1; x * x + y * y <= radius2; ++y) {
      if (x * x + y * y == radius2) all.push_back({scale * x, scale * y});
    }
  }
  // One quarter of the circle, by ascending angle.
  std::sort(all.begin(), all.end(), [](auto a, auto b) { return a.x > b.x; });
  Ring out;
  for (;;) {
    for (int quarter = 0; quarter < 4; ++quarter) {
      for (const LatticePoint p : all) {
        if (random.between(0, 3) != 0) out.push_back(Motion{quarter, {}}(p));
      }
    }
    if (out.size() >= 3) return out;
    out.clear();
  }
}

inline Pslg any_cocircular(Random& random) {
  constexpr int kRadius2[] = {25, 65, 325, 1105, 4225, 5525, 27'625};
  for (;;) {
    const int radius2 = kRadius2[random.between(0, 6)], scale = random.between(2, 200);
    Pslg out{{any_ring_on_a_circle(random, radius2, scale)}};
    if (random.between(0, 1) == 0) {
      Ring hole = any_ring_on_a_circle(random, radius2, random.between(1, scale - 1));
      std::reverse(hole.begin(), hole.end());
      add_if_valid(out, hole);
    }
    if (check_pslg(out)) return out;
  }
}

/// The stress cases that are rings of moderate size. Larger ones, and those at the ends of the
/// lattice, are in stress_cases_meshing_test only.
inline const std::vector<Pslg>& corpus_outlines() {
  static const std::vector<Pslg> kOutlines = [] {
    std::vector<Pslg> out;
    for (const auto& file : case_files(TROCAR_CORPUS "/pslg")) {
      const auto read = parse_pslg_case(text_of(file), file.filename());
      if (!read || read->picture || read->outline.rings.empty() || !check_pslg(read->outline))
        continue;
      std::size_t corners = 0;
      std::int32_t extent = 0;
      for (const Ring& ring : read->outline.rings) {
        corners += ring.size();
        for (const LatticePoint p : ring)
          extent = std::max({extent, std::abs(p.x), std::abs(p.y)});
      }
      if (corners <= 200 && extent <= 1 << 18) out.push_back(read->outline);
    }
    return out;
  }();
  return kOutlines;
}

inline Pslg any_outline_of(OutlineKind kind) {
  const int size = any_in(8, 40);
  Random random(any_seed());
  switch (kind) {
    case OutlineKind::kContours:
      return pipeline::contours(pipeline::noise_field(size, any_in(1, 6), any_seed()),
                                {0.5, 0.5, 0, 0, kLattice}, pipeline::ContourKind::kSubpixel);
    case OutlineKind::kChains:
      return pipeline::contours(pipeline::noise_field(size, any_in(1, 4), any_seed()),
                                {0.5, 0.5, 0, 0, kLattice}, pipeline::ContourKind::kPixel);
    case OutlineKind::kStars:
      return any_star(random, 100 * size);
    case OutlineKind::kSpecks:
      return any_specks(random, 100 * size);
    case OutlineKind::kNeedles:
      return any_needles(random);
    case OutlineKind::kNearCoincident:
      return any_near_coincident(random, 100 * size);
    case OutlineKind::kCocircular:
      return any_cocircular(random);
    case OutlineKind::kCorpus:
      break;
  }
  return *rc::gen::elementOf(corpus_outlines());
}

inline Pslg any_outline() {
  return any_outline_of(static_cast<OutlineKind>(any_in(0, kOutlineKinds)));
}

}  // namespace trocar::test
