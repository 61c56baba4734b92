// SPDX-License-Identifier: BSD-3-Clause
#include "place/joining.h"

#include "base/parallel.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

namespace dsorb::place {
namespace {

constexpr std::size_t kCandidates = 4;  // of a query
constexpr double kSameShare = 0.15;     // of what is seen, and rad, by which agreeing links differ

/// Whether two links between the same segments say the same, by where they put the cameras of one.
bool agree(const KeyframeStore& store, const Link& a, const Link& b) {
  const SE3& camera = store[b.from].T_world_cam;
  const SE3 by_a = a.S_to_from.moved(camera);
  const SE3 by_b = b.S_to_from.moved(camera);
  const double distance = store.medianInverseDepth(b.from) / b.S_to_from.scale;
  const Vector6d change = (by_a.inverse() * by_b).log();
  return change.head<3>().norm() * distance < kSameShare && change.tail<3>().norm() < kSameShare &&
         std::abs(std::log(a.S_to_from.scale / b.S_to_from.scale)) < kSameShare;
}

/// The same link the other way round.
Link turned(const Link& link) {
  Link result = link;
  std::swap(result.from, result.to);
  result.S_to_from = link.S_to_from.inverse();
  const Matrix7d adjoint = result.S_to_from.adjoint();
  result.covariance = adjoint * link.covariance * adjoint.transpose();
  return result;
}

/// The link by the candidate that a query shows most of.
std::optional<Link> bestLink(const KeyframeStore& store,
                             const BinaryIndex& index,
                             std::size_t query,
                             const std::function<bool(std::size_t, std::size_t)>& wanted) {
  const StoredKeyframe& keyframe = store[query];
  std::optional<Recognition> best;
  for (const BinaryIndex::Candidate& candidate :
       index.query(keyframe.view.descriptors, kCandidates, [&](std::size_t i) {
         return wanted(query, i);
       })) {
    std::optional<Recognition> seen =
        recognize(store, {&keyframe.view, keyframe.camera, keyframe.radial}, candidate.image);
    if (seen && (!best || seen->points.size() > best->points.size())) best = std::move(seen);
  }
  return best ? link(store, query, *best) : std::nullopt;
}

}  // namespace

std::vector<Link> findLinks(
    const KeyframeStore& store,
    const BinaryIndex& index,
    const std::vector<std::size_t>& queries,
    const std::function<bool(std::size_t query, std::size_t candidate)>& wanted) {
  std::vector<std::optional<Link>> found(queries.size());
  forEachRange(queries.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) found[i] = bestLink(store, index, queries[i], wanted);
  });
  std::vector<Link> links;
  for (std::optional<Link>& link : found) {
    if (link) links.push_back(*std::move(link));
  }
  return links;
}

std::vector<Join> joinsOf(const KeyframeStore& store, const std::vector<Link>& links) {
  std::map<std::pair<int, int>, std::vector<Link>> by_pair;  // into, segment
  for (const Link& link : links) {
    const int from = store[link.from].segment;
    const int to = store[link.to].segment;
    by_pair[{std::min(from, to), std::max(from, to)}].push_back(from < to ? turned(link) : link);
  }
  std::vector<Join> joins;
  for (const auto& [pair, all] : by_pair) {
    std::size_t most = 0;
    std::vector<const Link*> supporters;
    for (const Link& link : all) {
      std::vector<const Link*> agreeing;
      for (const Link& other : all) {
        if (agree(store, link, other)) agreeing.push_back(&other);
      }
      if (agreeing.size() <= most) continue;
      most = agreeing.size();
      supporters = agreeing;
    }
    const Link& surest =
        **std::max_element(supporters.begin(), supporters.end(), [](const Link* a, const Link* b) {
          return a->matches < b->matches;
        });
    Join join{pair.second, pair.first, surest.S_to_from, surest.covariance, 0, 0, 1};
    std::set<std::size_t> from;
    std::set<std::size_t> to;
    for (const Link* link : supporters) {
      from.insert(link->from);
      to.insert(link->to);
      join.matches += link->matches;
    }
    join.keyframes = static_cast<int>(std::max(from.size(), to.size()));
    join.wrong_probability = surest.wrong_probability;
    joins.push_back(join);
  }
  std::stable_sort(joins.begin(), joins.end(), [](const Join& a, const Join& b) {
    return a.matches > b.matches;
  });
  return joins;
}

}  // namespace dsorb::place
