// SPDX-License-Identifier: BSD-3-Clause
#include "place/loops.h"

#include "dsorb/place/place.h"

#include "base/median.h"
#ifdef DSORB_WITH_POSE_GRAPH
#include "place/pose_graph.h"
#endif

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>

namespace dsorb::place {

#ifdef DSORB_WITH_POSE_GRAPH
namespace {

// What an odometry gets wrong from one keyframe to the next.
constexpr double kTurnSigma = 1e-3;    // [rad]
constexpr double kMotionSigma = 0.01;  // of the motion
constexpr double kMotionFloor = 2e-4;  // of the distance to what is seen
constexpr double kScaleSigma = 3e-3;   // of the logarithm
// What a loop's covariance does not know: depths that err together.
constexpr double kLoopFloor = 3e-4;  // of the distance, rad and of the logarithm
// Loops that are hardly open tell less than the odometry does.
constexpr double kOpen = 9;  // chi-square by degree of freedom, the median of the loops

Similarity cameraOf(const StoredKeyframe& keyframe) {
  return {keyframe.T_world_cam, 1};
}

GraphEdge stepEdge(const KeyframeStore& store, std::size_t a, std::size_t b) {
  GraphEdge edge;
  edge.S_i_j = cameraOf(store[a]).inverse() * cameraOf(store[b]);
  const double depth = 1 / std::max(1e-6, store.medianInverseDepth(a));
  const double moved =
      std::hypot(kMotionSigma * edge.S_i_j.motion.translation().norm(), kMotionFloor * depth);
  Vector7d variances;
  variances << moved * moved, moved * moved, moved * moved, kTurnSigma * kTurnSigma,
      kTurnSigma * kTurnSigma, kTurnSigma * kTurnSigma, kScaleSigma * kScaleSigma;
  edge.covariance = variances.asDiagonal();
  return edge;
}

GraphEdge loopEdge(const KeyframeStore& store, const Link& link) {
  GraphEdge edge;
  const Similarity S_to_world = cameraOf(store[link.to]).inverse();
  edge.S_i_j = S_to_world * link.S_to_from * cameraOf(store[link.from]);
  const Matrix7d adjoint = S_to_world.adjoint();
  const double depth = 1 / std::max(1e-6, store.medianInverseDepth(link.to));
  Vector7d floor = Vector7d::Constant(kLoopFloor * kLoopFloor);
  floor.head<3>() *= depth * depth;
  edge.covariance = adjoint * link.covariance * adjoint.transpose();
  edge.covariance.diagonal() += floor;
  edge.doubtful = true;
  return edge;
}

/// Square of how far a loop is open, over its standard deviations, by degree of freedom.
double openness(const GraphEdge& loop, const Similarity& S_i_j) {
  const Similarity off = S_i_j * loop.S_i_j.inverse();
  Eigen::Matrix<double, 7, 1> xi;
  xi << off.motion.translation(), so3Log(off.motion.unitQuaternion()), std::log(off.scale);
  const Eigen::Matrix<double, 7, 7> covariance = loop.covariance;
  return xi.dot(covariance.ldlt().solve(xi)) / 7;
}

}  // namespace

std::vector<Similarity> closeLoops(const KeyframeStore& store,
                                   int segment,
                                   const std::vector<Link>& links,
                                   int num_threads) {
  if (links.empty()) return {};
  const std::vector<std::size_t>& members = store.inSegment(segment);
  std::map<std::size_t, std::size_t> place;
  std::vector<Similarity> start;
  std::vector<GraphEdge> edges;
  for (const std::size_t k : members) {
    const std::size_t here = start.size();
    place[k] = here;
    start.push_back(cameraOf(store[k]));
    for (std::size_t back = 1; back <= std::min<std::size_t>(2, here); ++back) {
      if (store[members[here - back]].stretch != store[k].stretch) continue;  // links hold these
      GraphEdge edge = stepEdge(store, members[here - back], k);
      edge.i = here - back;
      edge.j = here;
      edges.push_back(edge);
    }
  }
  std::vector<double> open;
  for (const Link& link : links) {
    GraphEdge edge = loopEdge(store, link);
    edge.i = place.at(link.to);
    edge.j = place.at(link.from);
    open.push_back(openness(edge, start[edge.i].inverse() * start[edge.j]));
    edges.push_back(edge);
  }
  if (medianInPlace(open) < kOpen) return {};
  std::vector<Similarity> changes = adjustGraph(start, edges, num_threads);
  for (std::size_t k = 0; k < changes.size(); ++k) changes[k] = changes[k] * start[k].inverse();
  return changes;
}

#else

std::vector<Similarity> closeLoops(const KeyframeStore& /*store*/,
                                   int /*segment*/,
                                   const std::vector<Link>& /*links*/,
                                   int /*num_threads*/) {
  return {};
}

#endif

}  // namespace dsorb::place

bool dsorb::canCloseLoops() {
#ifdef DSORB_WITH_POSE_GRAPH
  return true;
#else
  return false;
#endif
}
