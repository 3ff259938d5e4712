// SPDX-License-Identifier: GPL-3.0-or-later
// The input of refinement: its segments, the angles between them, and where to split them near an
// acute angle (concentric shells: Ruppert, 1995; Shewchuk).
#pragma once

#include <cstdint>
#include <vector>

#include "pipeline/mesh/refinement.h"

namespace trocar::pipeline {

class RefinementOutline {
 public:
  static constexpr std::uint32_t kNoCorner = 0xffffffff, kNoTwin = 0xffffffff;

  /// Starts again and keeps the memory; segments are numbered in the order of add().
  void clear(std::size_t vertices);
  std::uint32_t add(std::uint32_t from, std::uint32_t to);
  /// Measures the angles between the segments, once all are added.
  void close(const std::vector<LatticePoint>& points);

  /// Finds the segments that two regions share, once all are added. Without it there are none.
  void find_twins(const std::vector<LatticePoint>& points);
  /// The segment with the same ends in the other order, or kNoTwin.
  std::uint32_t twin(std::uint32_t segment) const {
    return twins_.empty() ? kNoTwin : twins_[segment];
  }

  /// The loops that the segments form; where regions share borders, the parts of loops with the
  /// same material, or void, beyond them.
  void find_loops();
  /// Which segments may be split up to a step on the void's side.
  void find_room(const std::vector<LatticePoint>& points);
  /// After find_room(): may no part of the outline, each point of which stays within a step on the
  /// void's side of its segment and within three on the material's, meet one that does the same?
  bool has_room(std::uint32_t segment) const { return has_room_[segment] != 0; }
  /// After find_loops(): twice the area that splits have taken from the segment's loop so far.
  std::int64_t& lost_of_loop(std::uint32_t segment) { return lost_[loop_[segment]]; }

  const std::vector<Refined::Segment>& segments() const { return segments_; }
  /// Of an input vertex: the angle in the material; 360 for all of 90 and more.
  double angle_deg(std::uint32_t vertex) const { return angle_deg_[vertex]; }

  /// The corner where two segments (as in VertexOrigin: negative for none) meet under an angle
  /// below 60 degrees in the material, or kNoCorner.
  std::uint32_t small_corner(std::int32_t s, std::int32_t t) const {
    return s < 0 || t < 0 || s == t ? kNoCorner : small_corner_of_two(s, t);
  }

  /// Does a segment end in an acute corner (kAcuteCorner_deg), so that its splits belong on shells?
  /// Of a shared one, in a corner that is acute on either side.
  bool has_shells(std::uint32_t segment) const {
    return is_acute_from(segment) || is_acute_to(segment);
  }
  /// The fraction from a to b at which to split this piece of a segment that has shells, so that
  /// pieces of the two segments that meet in the nearer acute corner end at equal distances from
  /// it.
  double shell_fraction(std::uint32_t segment, LatticePoint a, LatticePoint b,
                        const std::vector<LatticePoint>& points) const;

 private:
  bool is_acute(std::uint32_t vertex) const;
  bool is_acute_from(std::uint32_t segment) const {
    return is_acute(segments_[segment].from) ||
           (twin(segment) != kNoTwin && is_acute(segments_[twin(segment)].to));
  }
  bool is_acute_to(std::uint32_t segment) const {
    return is_acute(segments_[segment].to) ||
           (twin(segment) != kNoTwin && is_acute(segments_[twin(segment)].from));
  }
  bool is_one_loop_with_previous(std::uint32_t segment) const;
  std::uint32_t small_corner_of_two(std::int32_t s, std::int32_t t) const;

  std::vector<Refined::Segment> segments_;
  std::vector<std::int32_t> into_;  // by input vertex: the segment that ends there
  std::vector<std::uint32_t> twins_;
  std::vector<double> angle_deg_;
  std::vector<char> has_room_;
  std::vector<std::uint32_t> loop_;
  std::vector<std::int64_t> lost_;  // by loop
};

}  // namespace trocar::pipeline
