// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "place/binary_index.h"
#include "place/keyframe_store.h"
#include "place/recognition.h"

#include <functional>
#include <vector>

namespace dsorb::place {

/// Links of keyframes to those that `wanted` admits, the best one of each.
/// Runs in parallel inside the caller's arena; the result does not depend on the number of threads.
[[nodiscard]] std::vector<Link> findLinks(
    const KeyframeStore& store,
    const BinaryIndex& index,
    const std::vector<std::size_t>& queries,
    const std::function<bool(std::size_t query, std::size_t candidate)>& wanted);

/// Two segments that share a view.
struct Join {
  int segment = 0;
  int into = 0;
  Similarity S_into_segment;
  Matrix7d covariance;
  int keyframes = 0;
  int matches = 0;
  double wrong_probability = 1;
};

/// Joins by which segments hang together: of each pair that has links, as most of them say.
[[nodiscard]] std::vector<Join> joinsOf(const KeyframeStore& store, const std::vector<Link>& links);

}  // namespace dsorb::place
