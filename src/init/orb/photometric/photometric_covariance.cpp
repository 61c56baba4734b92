// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_covariance.h"

#include "base/parallel.h"
#include "estimate/sampling.h"
#include "estimate/warp.h"
#include "init/orb/map/image_cells.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace dsorb::init_orb {
namespace {

constexpr double kPoseVarianceFactor = 6;  // on the clustered covariance of photometric poses [-]
constexpr double kMatchError = 0.1;        // error that all frames share, along a gradient [px]
constexpr std::size_t kGrain = 64;         // patches one thread takes at a time

/// Patches sorted by cell, and where each cell begins.
struct CellOrder {
  std::vector<std::size_t> patches;
  std::vector<std::size_t> begin;  ///< of occupied cells; one more at the end

  explicit CellOrder(const PhotometricProblem& problem) : patches(problem.patches.size()) {
    std::vector<std::size_t> cells;
    const PinholeCamera& camera = problem.camera;
    for (const HostPatch& patch : problem.patches) {
      const Eigen::Vector3d ray = patch.ray.cast<double>().homogeneous();
      cells.push_back(imageCell(camera.project(ray), camera));
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

/// Direction in which all translations grow together: it leaves every residual unchanged.
Eigen::VectorXd scaleDirection(const PhotometricState& state, int frame_size) {
  const auto frames = static_cast<Eigen::Index>(state.T_cam_ref.size());
  Eigen::VectorXd direction = Eigen::VectorXd::Zero(frames * frame_size);
  for (Eigen::Index f = 0; f < frames; ++f) {
    direction.segment<3>(f * frame_size) =
        state.T_cam_ref[static_cast<std::size_t>(f)].translation();
  }
  return direction;
}

/// Only the rows that belong to poses, 6 a frame.
Eigen::MatrixXd poseRows(const Eigen::MatrixXd& frames, int frame_size) {
  const Eigen::Index count = frames.rows() / frame_size;
  Eigen::MatrixXd poses(6 * count, frames.cols());
  for (Eigen::Index f = 0; f < count; ++f) {
    poses.middleRows<6>(6 * f) = frames.middleRows<6>(f * frame_size);
  }
  return poses;
}

/// The other way round: zeros where frames have more unknowns than their pose.
Eigen::MatrixXd spreadPoses(const Eigen::MatrixXd& poses, int frame_size) {
  const Eigen::Index count = poses.rows() / 6;
  Eigen::MatrixXd frames = Eigen::MatrixXd::Zero(count * frame_size, count * frame_size);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) {
      frames.block<6, 6>(i * frame_size, j * frame_size) = poses.block<6, 6>(6 * i, 6 * j);
    }
  }
  return frames;
}

/// Largest motion along the patch's gradients by a unit of inverse depth.
double speedOf(const HostPatch& patch,
               const PatchGradients& gradients,
               const PhotometricProblem& problem,
               const PhotometricState& state,
               std::size_t index) {
  Eigen::Matrix2d tensor = Eigen::Matrix2d::Zero();
  for (std::size_t j = 0; j < kPattern.size(); ++j) {
    const Eigen::Vector2d gradient(static_cast<double>(gradients.x[j]),
                                   static_cast<double>(gradients.y[j]));
    tensor += static_cast<double>(patch.weight[j]) * gradient * gradient.transpose();
  }
  double best = 0;
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    if (problem.seenIn(f)[index] == 0) continue;
    const auto projection = projectHosted(problem.camera,
                                          state.T_cam_ref[f],
                                          patch.ray.cast<double>().homogeneous(),
                                          state.inverse_depth[index]);
    if (!projection) continue;
    const Eigen::Vector2d& d = projection->J_inverse_depth;
    best = std::max(best, d.dot(tensor * d) / std::max(tensor.trace(), 1e-12));
  }
  return std::sqrt(best);
}

}  // namespace

PhotometricEvidence::PhotometricEvidence(const PhotometricProblem& problem,
                                         const PhotometricState& state,
                                         const PhotometricOptions& options)
    : problem_(problem), state_(state), options_(options) {
  if (problem.patches.empty() || problem.frames.empty()) return;
  PhotometricLinearizer(problem, options).linearize(state, equations_);
  countResiduals();
  marginals_ = Marginals(
      equations_.system, scaleDirection(state, equations_.frame_size), state.inverse_depth);
  usable_ = marginals_.usable() && noise_variance_ > 0;
}

void PhotometricEvidence::countResiduals() {
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

/// Calls function(first patch, effects) on runs of patches: column i is -d inverse depth / d frames
/// of the i-th patch of the run, mean inverse depth fixed; NaN where it is not known.
template <typename Function>
void PhotometricEvidence::forEachEffect(Function&& function) const {
  const Eigen::Index size = equations_.system.size();
  const std::size_t patches = problem_.patches.size();
  const std::size_t runs = (patches + kGrain - 1) / kGrain;  // fixed: products depend on the width
  forEachRange(runs, 1, [&](std::size_t begin, std::size_t end) {
    Eigen::MatrixXd effects;
    for (std::size_t run = begin; run < end; ++run) {
      const std::size_t first = run * kGrain;
      const std::size_t last = std::min(first + kGrain, patches);
      effects.resize(size, static_cast<Eigen::Index>(last - first));
      for (std::size_t i = first; i < last; ++i) {
        marginals_.depthEffect(equations_.system,
                               i,
                               state_.inverse_depth[i],
                               effects.col(static_cast<Eigen::Index>(i - first)));
      }
      function(first, effects);
    }
  });
}

Eigen::VectorXd PhotometricEvidence::formalVariances() const {
  Eigen::VectorXd variances =
      Eigen::VectorXd::Zero(static_cast<Eigen::Index>(problem_.patches.size()));
  const Eigen::MatrixXd roots = marginals_.roots();
  forEachEffect([&](std::size_t first, const Eigen::MatrixXd& effects) {
    const Eigen::MatrixXd spread = roots.transpose() * effects;
    for (Eigen::Index k = 0; k < effects.cols(); ++k) {
      const std::size_t i = first + static_cast<std::size_t>(k);
      if (!equations_.system.known(i)) continue;
      const auto h = static_cast<double>(equations_.system.depth_hessian[i]);
      variances[static_cast<Eigen::Index>(i)] =
          noise_variance_ * (1 / h + spread.col(k).squaredNorm());
    }
  });
  return variances;
}

Eigen::VectorXd PhotometricEvidence::variances(const Eigen::MatrixXd& poses) const {
  Eigen::VectorXd variances =
      Eigen::VectorXd::Zero(static_cast<Eigen::Index>(problem_.patches.size()));
  const Eigen::MatrixXd frames = spreadPoses(poses, equations_.frame_size);
  forEachEffect([&](std::size_t first, const Eigen::MatrixXd& effects) {
    const Eigen::MatrixXd spread = frames * effects;
    for (Eigen::Index k = 0; k < effects.cols(); ++k) {
      const std::size_t i = first + static_cast<std::size_t>(k);
      if (!equations_.system.known(i)) continue;
      const double redundancy = kPatternSize * observations_[i] - 1;
      const double own = static_cast<double>(equations_.energy[i]) / redundancy;
      variances[static_cast<Eigen::Index>(i)] =
          std::max(noise_variance_, own) / static_cast<double>(equations_.system.depth_hessian[i]) +
          effects.col(k).dot(spread.col(k));
    }
  });
  return variances;
}

/// S^- (sum over cells of q q^T) S^-, q the gradient that the cell's patches leave to the frames.
Eigen::MatrixXd PhotometricEvidence::clusteredPoseCovariance() const {
  const CellOrder order(problem_);
  const PhotometricProblem sorted = subProblem(problem_, order.patches);
  PhotometricState sorted_state = state_;
  for (std::size_t i = 0; i < order.patches.size(); ++i) {
    sorted_state.inverse_depth[i] = state_.inverse_depth[order.patches[i]];
  }
  PhotometricLinearizer linearizer(sorted, options_, order.begin);
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
  const Eigen::MatrixXd roots = poseRows(
      marginals_.inGauge(marginals_.clusteredRoots(gradients, frames)), equations_.frame_size);
  return roots * roots.transpose();
}

PatchGradients hostGradients(const HostPatch& patch,
                             const PinholeCamera& camera,
                             const PyramidLevel& reference) {
  PatchGradients gradients;
  const auto x = static_cast<float>(camera.fx * static_cast<double>(patch.ray.x()) + camera.cx);
  const auto y = static_cast<float>(camera.fy * static_cast<double>(patch.ray.y()) + camera.cy);
  for (std::size_t j = 0; j < kPattern.size(); ++j) {
    const Sample<float> sample = interpolate(
        reference, x + static_cast<float>(kPattern[j].x), y + static_cast<float>(kPattern[j].y));
    gradients.x[j] = sample.dx;
    gradients.y[j] = sample.dy;
  }
  return gradients;
}

namespace {

/// The corners' covariance of some frames' poses, 6 rows each; zero when there is none.
Eigen::MatrixXd geometricCovariance(const InitialMap& map, const PhotometricProblem& problem) {
  const auto count = static_cast<Eigen::Index>(problem.frames.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(6 * count, 6 * count);
  const auto row_of = [&](Eigen::Index frame) {
    return jointRow(map, problem.frames[static_cast<std::size_t>(frame)].index);
  };
  for (Eigen::Index i = 0; i < count; ++i) {
    if (row_of(i) < 0) return covariance;
  }
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) {
      covariance.block<6, 6>(6 * i, 6 * j) = map.joint_covariance.block<6, 6>(row_of(i), row_of(j));
    }
  }
  return covariance;
}

std::vector<int> framesOf(const PhotometricProblem& problem) {
  std::vector<int> frames;
  for (const PhotometricFrame& frame : problem.frames) {
    frames.push_back(static_cast<int>(frame.index));
  }
  return frames;
}

/// speedOf() every patch.
std::vector<double> speedsOf(const PhotometricProblem& problem,
                             const PhotometricState& state,
                             const PyramidLevel& reference) {
  std::vector<double> speeds(problem.patches.size());
  forEachRange(speeds.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const HostPatch& patch = problem.patches[i];
      speeds[i] =
          speedOf(patch, hostGradients(patch, problem.camera, reference), problem, state, i);
    }
  });
  return speeds;
}

}  // namespace

bool setPhotometricVariances(InitialMap& map,
                             PhotometricProblem& problem,
                             const PhotometricOptions& options,
                             bool poses_moved) {
  const PhotometricState state = makeState(problem, map);
  findVisible(problem, state);
  const PhotometricEvidence evidence(problem, state, options);
  if (!evidence.usable()) return false;
  const Eigen::MatrixXd poses =
      poses_moved ? Eigen::MatrixXd(kPoseVarianceFactor * evidence.clusteredPoseCovariance())
                  : geometricCovariance(map, problem);
  if (poses_moved) setJointCovariance(map, framesOf(problem), poses);
  const Eigen::VectorXd variances = evidence.variances(poses);
  const std::vector<double> speeds = speedsOf(problem, state, map.frames.front().frame->level(0));
  const std::size_t corners = map.corners.size();
  for (std::size_t i = 0; i < problem.patches.size(); ++i) {
    double variance = variances[static_cast<Eigen::Index>(i)];
    if (!(variance > 0) || !(speeds[i] > 0)) continue;
    const double shift = kMatchError / speeds[i];
    variance += shift * shift;
    if (problem.source[i] < corners) {
      map.corners[problem.source[i]].variance = variance;
    } else {
      map.points[problem.source[i] - corners].variance = static_cast<float>(variance);
    }
  }
  return true;
}

}  // namespace dsorb::init_orb
