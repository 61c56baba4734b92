// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_covariance.h"

#include "base/parallel.h"
#include "estimate/sampling.h"
#include "estimate/warp.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace dsorb::init_orb {
namespace {

constexpr double kPoseVarianceFactor = 6;  // on the clustered covariance of photometric poses [-]
constexpr double kMatchError = 0.1;        // error that all frames share, along a gradient [px]
/// A patch is taken to be as deep everywhere. Where the surface slants, the edges that tell its
/// depth lie beside its centre: a share of the inverse depth. docs/experiments.md, "Variances of
/// depths and poses"
constexpr double kSlantError = 0.006;
constexpr std::size_t kRunLength = 64;  // patches one thread takes at a time

/// Patches sorted by cell, and where each cell begins.
struct CellOrder {
  std::vector<std::size_t> patches;
  std::vector<std::size_t> begin;  ///< of occupied cells; one more at the end

  explicit CellOrder(const PhotometricProblem& problem) : patches(problem.patches.size()) {
    std::vector<std::size_t> cells;
    for (const HostPatch& patch : problem.patches) {
      cells.push_back(imageCell(patch.pixel.cast<double>(), problem.camera));
    }
    std::iota(patches.begin(), patches.end(), std::size_t{0});
    std::stable_sort(patches.begin(), patches.end(), [&](std::size_t a, std::size_t b) {
      return cells[a] < cells[b];
    });
    for (std::size_t i = 0; i < patches.size(); ++i) {
      if (i == 0 || cells[patches[i]] != cells[patches[i - 1]]) begin.push_back(i);
    }
    begin.push_back(patches.size());
  }
};

/// Rows that belong to poses, 6 a frame.
std::vector<Eigen::Index> poseRows(std::size_t frames, int frame_size) {
  std::vector<Eigen::Index> rows;
  for (std::size_t f = 0; f < frames; ++f) {
    for (int d = 0; d < 6; ++d) rows.push_back(static_cast<Eigen::Index>(f) * frame_size + d);
  }
  return rows;
}

/// Largest motion along the patch's gradients by a unit of inverse depth.
double speedOf(const PatchGradients& gradients,
               const PhotometricProblem& problem,
               const PhotometricState& state,
               std::size_t index) {
  const HostPatch& patch = problem.patches[index];
  Eigen::Matrix2d tensor = Eigen::Matrix2d::Zero();
  for (std::size_t j = 0; j < kPattern.size(); ++j) {
    const Eigen::Vector2d gradient(static_cast<double>(gradients.x[j]),
                                   static_cast<double>(gradients.y[j]));
    const auto root = static_cast<double>(patch.root_weight[j]);
    tensor += root * root * gradient * gradient.transpose();
  }
  const Eigen::Vector3d ray = problem.camera.unproject(patch.pixel.cast<double>());
  double best = 0;
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    if (problem.seenIn(f)[index] == 0) continue;
    const auto projection =
        projectHosted(problem.camera, state.T_cam_ref[f], ray, state.inverse_depth[index]);
    if (!projection) continue;
    const Eigen::Vector2d& d = projection->J_inverse_depth;
    best = std::max(best, d.dot(tensor * d) / std::max(tensor.trace(), 1e-12));
  }
  return std::sqrt(best);
}

}  // namespace

PhotometricMarginals::PhotometricMarginals(const PhotometricProblem& problem,
                                           const PhotometricState& state)
    : problem_(problem), state_(state) {
  if (problem.patches.empty() || problem.frames.empty()) return;
  PhotometricLinearizer(problem).linearize(state, equations_);
  countResiduals();
  marginals_ = Marginals(equations_.system,
                         problem.known.empty()
                             ? scaleDirection(state.T_cam_ref, equations_.frame_size)
                             : Eigen::VectorXd(Eigen::VectorXd::Zero(equations_.system.size())),
                         state.inverse_depth);
  usable_ = marginals_.usable() && noise_variance_ > 0;
}

void PhotometricMarginals::countResiduals() {
  const std::size_t patches = problem_.patches.size();
  observations_.assign(patches, 0);
  int count = 0;
  for (std::size_t f = 0; f < problem_.frames.size(); ++f) {
    const char* seen = problem_.seenIn(f);
    for (std::size_t i = 0; i < patches; ++i) observations_[i] += seen[i] != 0 ? 1 : 0;
  }
  for (const int observations : observations_) count += observations * kPatternSize;
  const double redundancy =
      count - static_cast<double>(patches) - static_cast<double>(equations_.system.size());
  noise_variance_ = redundancy > 0 ? 2 * equations_.cost / redundancy : 0;
}

double PhotometricMarginals::knownShare(std::size_t patch) const {
  if (problem_.known.empty()) return 0;
  const auto curvature = static_cast<double>(equations_.system.depth_hessian[patch]);
  if (!(curvature > 0)) return 0;
  return knownTerm(problem_, patch, state_.inverse_depth[patch]).hessian / curvature;
}

double PhotometricMarginals::mixedVariance(std::size_t patch, double of_images) const {
  if (problem_.known.empty()) return of_images;
  const double known = knownShare(patch);
  return (1 - known) * of_images + known * kGreyVariance;
}

template <typename Own>
Eigen::VectorXd PhotometricMarginals::variancesWith(const Eigen::MatrixXd& frames,
                                                    Own&& own) const {
  const LinearSystem<float>& system = equations_.system;
  const std::size_t patches = problem_.patches.size();
  Eigen::VectorXd variances = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(patches));
  const std::size_t runs =
      (patches + kRunLength - 1) / kRunLength;  // fixed: products depend on the width
  forEachRange(runs, 1, [&](std::size_t begin, std::size_t end) {
    Eigen::MatrixXd effects;
    for (std::size_t run = begin; run < end; ++run) {
      const auto first = static_cast<Eigen::Index>(run * kRunLength);
      effects.resize(system.size(), std::min<Eigen::Index>(kRunLength, variances.size() - first));
      for (Eigen::Index k = 0; k < effects.cols(); ++k) {
        const auto i = static_cast<std::size_t>(first + k);
        marginals_.depthEffect(system, i, state_.inverse_depth[i], effects.col(k));
      }
      const Eigen::MatrixXd spread = frames * effects;
      for (Eigen::Index k = 0; k < effects.cols(); ++k) {
        const auto i = static_cast<std::size_t>(first + k);
        if (!system.known(i)) continue;
        variances[first + k] = own(i) / static_cast<double>(system.depth_hessian[i]) +
                               effects.col(k).dot(spread.col(k));
      }
    }
  });
  return variances;
}

Eigen::VectorXd PhotometricMarginals::formalVariances() const {
  const Eigen::MatrixXd roots = marginals_.roots();
  return variancesWith(noise_variance_ * roots * roots.transpose(),
                       [this](std::size_t i) { return mixedVariance(i, noise_variance_); });
}

Eigen::VectorXd PhotometricMarginals::variances(const Eigen::MatrixXd& poses) const {
  const Eigen::Index size = equations_.system.size();
  const auto rows = poseRows(problem_.frames.size(), equations_.frame_size);
  Eigen::MatrixXd frames = Eigen::MatrixXd::Zero(size, size);
  frames(rows, rows) = poses;
  return variancesWith(frames, [this](std::size_t i) {
    const double redundancy = kPatternSize * observations_[i] - 1;
    return mixedVariance(
        i, std::max(noise_variance_, static_cast<double>(equations_.energy[i]) / redundancy));
  });
}

/// S^- (sum over cells of q q^T) S^-, q the gradient that the cell's patches leave to the frames.
Eigen::MatrixXd PhotometricMarginals::clusteredPoseCovariance() const {
  const CellOrder order(problem_);
  const PhotometricProblem sorted = subProblem(problem_, order.patches);
  PhotometricState sorted_state = state_;
  for (std::size_t i = 0; i < order.patches.size(); ++i) {
    sorted_state.inverse_depth[i] = state_.inverse_depth[order.patches[i]];
  }
  PhotometricLinearizer linearizer(sorted, order.begin);
  PhotometricEquations equations;
  linearizer.linearize(sorted_state, equations);
  const LinearSystem<float>& system = equations_.system;
  const std::size_t cells = order.begin.size() - 1;
  Eigen::MatrixXd gradients(system.size(), static_cast<Eigen::Index>(cells));
  for (std::size_t cell = 0; cell < cells; ++cell) {
    Eigen::VectorXd q = linearizer.blockGradient(cell);
    for (std::size_t at = order.begin[cell]; at < order.begin[cell + 1]; ++at) {
      const std::size_t i = order.patches[at];
      if (!system.known(i)) continue;
      q -= system.couplingOf(i).cast<double>() * (static_cast<double>(system.depth_gradient[i]) /
                                                  static_cast<double>(system.depth_hessian[i]));
    }
    gradients.col(static_cast<Eigen::Index>(cell)) = q;
  }
  const auto frames = static_cast<Eigen::Index>(problem_.frames.size());
  const Eigen::MatrixXd all = marginals_.inGauge(marginals_.clusteredRoots(gradients, frames));
  const Eigen::MatrixXd roots =
      all(poseRows(problem_.frames.size(), equations_.frame_size), Eigen::seqN(0, all.cols()));
  return roots * roots.transpose();
}

PatchGradients hostGradients(const HostPatch& patch, const PyramidLevel& reference) {
  PatchGradients gradients;
  for (std::size_t j = 0; j < kPattern.size(); ++j) {
    const Sample<float> sample = interpolate(reference,
                                             patch.seen.x() + static_cast<float>(kPattern[j].x),
                                             patch.seen.y() + static_cast<float>(kPattern[j].y));
    gradients.x[j] = sample.dx;
    gradients.y[j] = sample.dy;
  }
  return gradients;
}

namespace {

/// The corners' covariance of some frames' poses, 6 rows each; zero when there is none.
Eigen::MatrixXd geometricCovariance(const InitialMap& map, const PhotometricProblem& problem) {
  const std::vector<Eigen::Index> rows = jointRows(map, problem);
  const auto size = static_cast<Eigen::Index>(6 * problem.frames.size());
  if (rows.empty()) return Eigen::MatrixXd::Zero(size, size);
  return map.joint_covariance(rows, rows);
}

std::vector<std::size_t> framesOf(const PhotometricProblem& problem) {
  std::vector<std::size_t> frames;
  for (const PhotometricFrame& frame : problem.frames) frames.push_back(frame.index);
  return frames;
}

/// speedOf() every patch.
std::vector<double> speedsOf(const PhotometricProblem& problem,
                             const PhotometricState& state,
                             const PyramidLevel& reference) {
  std::vector<double> speeds(problem.patches.size());
  forEachRange(speeds.size(), kRunLength, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      speeds[i] = speedOf(hostGradients(problem.patches[i], reference), problem, state, i);
    }
  });
  return speeds;
}

}  // namespace

std::optional<InitialMap> withPhotometricVariances(InitialMap map,
                                                   PhotometricProblem problem,
                                                   bool poses_moved) {
  const PhotometricState state = makeState(problem, map);
  findVisible(problem, state);
  const PhotometricMarginals marginals(problem, state);
  if (!marginals.usable()) return std::nullopt;
  const Eigen::MatrixXd poses =
      poses_moved ? Eigen::MatrixXd(kPoseVarianceFactor * marginals.clusteredPoseCovariance())
                  : geometricCovariance(map, problem);
  if (poses_moved) setJointCovariance(map, framesOf(problem), poses);
  const Eigen::VectorXd variances = marginals.variances(poses);
  const std::vector<double> speeds = speedsOf(problem, state, map.frames.front().frame->level(0));
  const std::size_t corners = map.corners.size();
  for (std::size_t i = 0; i < problem.patches.size(); ++i) {
    double variance = variances[static_cast<Eigen::Index>(i)];
    const double share = marginals.imageShare(i);
    if (!(variance > 0) || !(speeds[i] > 0)) continue;
    const double shift = share * kMatchError / speeds[i];
    const double slant = share * kSlantError * state.inverse_depth[i];
    variance += shift * shift + slant * slant;
    if (problem.source[i] < corners) {
      map.corners[problem.source[i]].variance = variance;
    } else {
      map.points[problem.source[i] - corners].variance = static_cast<float>(variance);
    }
  }
  return map;
}

}  // namespace dsorb::init_orb
