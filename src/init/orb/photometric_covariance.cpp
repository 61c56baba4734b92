// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric_covariance.h"

#include "camera/reprojection.h"
#include "image/interpolate.h"
#include "init/orb/photometric_equations.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace dsorb::init_orb {
namespace {

constexpr int kCellsX = 10;  // of the image; errors inside a cell count as one
constexpr int kCellsY = 8;

std::size_t cellOf(const HostPatch& patch, const PinholeCamera& camera) {
  const auto index = [](double pixel, int size, int cells) {
    return static_cast<std::size_t>(
        std::clamp(static_cast<int>(pixel * cells / size), 0, cells - 1));
  };
  const double x = camera.fx * static_cast<double>(patch.ray.x()) + camera.cx;
  const double y = camera.fy * static_cast<double>(patch.ray.y()) + camera.cy;
  return index(y, camera.height, kCellsY) * kCellsX + index(x, camera.width, kCellsX);
}

/// Patches sorted by cell, and where each cell begins.
struct CellOrder {
  std::vector<std::size_t> patches;
  std::vector<std::size_t> begin;  ///< of occupied cells; one more at the end

  explicit CellOrder(const PhotometricProblem& problem) : patches(problem.patches.size()) {
    std::vector<std::size_t> cells;
    for (const HostPatch& patch : problem.patches) cells.push_back(cellOf(patch, problem.camera));
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

/// The equations at the solution with everything that follows from them.
class Evidence {
 public:
  Evidence(const PhotometricProblem& problem,
           const PhotometricState& state,
           const PhotometricOptions& options);

  [[nodiscard]] bool usable() const { return usable_; }
  void fill(const PhotometricState& state, PhotometricUncertainty& out) const;

 private:
  void countResiduals(const PhotometricProblem& problem);
  [[nodiscard]] Eigen::MatrixXd poseRows(const Eigen::MatrixXd& frames) const;
  [[nodiscard]] Eigen::MatrixXd clusteredCovariance() const;

  CellOrder order_;
  PhotometricProblem sorted_;
  PhotometricEquations equations_;
  std::vector<Eigen::VectorXd> cell_gradients_;
  std::vector<int> observations_;  ///< by patch, sorted
  Eigen::VectorXd hessian_;        ///< by patch, sorted
  Eigen::MatrixXd ratio_;          ///< column i: coupling over depth Hessian
  Eigen::LLT<Eigen::MatrixXd> cholesky_;
  double noise_variance_ = 0;
  bool usable_ = false;
};

PhotometricState sortedState(const PhotometricState& state, const CellOrder& order) {
  PhotometricState sorted = state;
  for (std::size_t i = 0; i < order.patches.size(); ++i) {
    sorted.inverse_depth[i] = state.inverse_depth[order.patches[i]];
  }
  return sorted;
}

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

Evidence::Evidence(const PhotometricProblem& problem,
                   const PhotometricState& state,
                   const PhotometricOptions& options)
    : order_(problem), sorted_(subProblem(problem, order_.patches)) {
  PhotometricLinearizer linearizer(sorted_, options, order_.begin);
  linearizer.linearize(sortedState(state, order_), equations_);
  for (std::size_t cell = 0; cell + 1 < order_.begin.size(); ++cell) {
    cell_gradients_.push_back(linearizer.blockGradient(cell));
  }
  countResiduals(sorted_);
  const Eigen::Index size = equations_.hessian.rows();
  const auto patches = static_cast<Eigen::Index>(sorted_.patches.size());
  hessian_.resize(patches);
  ratio_.setZero(size, patches);
  Eigen::MatrixXd root = Eigen::MatrixXd::Zero(size, patches);
  for (Eigen::Index i = 0; i < patches; ++i) {
    const auto index = static_cast<std::size_t>(i);
    hessian_[i] = static_cast<double>(equations_.depth_hessian[index]);
    if (!(hessian_[i] > 0)) continue;
    ratio_.col(i) = equations_.couplingOf(index).cast<double>() / hessian_[i];
    root.col(i) = ratio_.col(i) * std::sqrt(hessian_[i]);
  }
  Eigen::MatrixXd schur = equations_.hessian;
  schur.selfadjointView<Eigen::Lower>().rankUpdate(root, -1.0);
  const Eigen::VectorXd scale = scaleDirection(state, equations_.frame_size).normalized();
  // The null direction gets the mean stiffness of the others; what it gets does not matter.
  schur += schur.trace() / static_cast<double>(size) * scale * scale.transpose();
  cholesky_.compute(schur);
  usable_ = cholesky_.info() == Eigen::Success && noise_variance_ > 0;
}

void Evidence::countResiduals(const PhotometricProblem& problem) {
  const std::size_t patches = problem.patches.size();
  observations_.assign(patches, 0);
  double count = 0;
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    for (std::size_t i = 0; i < patches; ++i) {
      observations_[i] += problem.seenIn(f)[i] != 0 ? 1 : 0;
      count += problem.seenIn(f)[i] != 0 ? kPatternSize : 0;
    }
  }
  const double redundancy =
      count - static_cast<double>(patches) - static_cast<double>(equations_.hessian.rows());
  noise_variance_ = redundancy > 0 ? 2 * equations_.cost / redundancy : 0;
}

/// S^- (sum over cells of q q^T) S^-, q the gradient that the cell's patches leave to the frames.
Eigen::MatrixXd Evidence::clusteredCovariance() const {
  const Eigen::Index size = equations_.hessian.rows();
  Eigen::MatrixXd spread = Eigen::MatrixXd::Zero(size, size);
  for (std::size_t cell = 0; cell < cell_gradients_.size(); ++cell) {
    Eigen::VectorXd q = cell_gradients_[cell];
    for (std::size_t i = order_.begin[cell]; i < order_.begin[cell + 1]; ++i) {
      q -= ratio_.col(static_cast<Eigen::Index>(i)) *
           static_cast<double>(equations_.depth_gradient[i]);
    }
    spread += q * q.transpose();
  }
  const auto cells = static_cast<double>(cell_gradients_.size());
  const auto frames = static_cast<double>(sorted_.frames.size());
  const Eigen::MatrixXd half = cholesky_.solve(spread);
  return cholesky_.solve(half.transpose()) * cells / std::max(cells - frames, 1.0);
}

/// Only the rows that belong to poses, 6 a frame.
Eigen::MatrixXd Evidence::poseRows(const Eigen::MatrixXd& frames) const {
  const auto count = static_cast<Eigen::Index>(sorted_.frames.size());
  Eigen::MatrixXd poses(6 * count, frames.cols());
  for (Eigen::Index f = 0; f < count; ++f) {
    poses.middleRows<6>(6 * f) = frames.middleRows<6>(f * equations_.frame_size);
  }
  return poses;
}

void Evidence::fill(const PhotometricState& state, PhotometricUncertainty& out) const {
  const auto patches = static_cast<Eigen::Index>(sorted_.patches.size());
  Eigen::VectorXd rho(patches);
  for (Eigen::Index i = 0; i < patches; ++i) {
    rho[i] = state.inverse_depth[order_.patches[static_cast<std::size_t>(i)]];
  }
  const double mean_rho = rho.mean();
  const Eigen::VectorXd mean_ratio = ratio_.rowwise().mean() / mean_rho;
  const Eigen::MatrixXd effect = ratio_ - mean_ratio * rho.transpose();
  const Eigen::VectorXd scale = scaleDirection(state, equations_.frame_size);
  const Eigen::Index size = equations_.hessian.rows();
  const Eigen::MatrixXd projector =
      Eigen::MatrixXd::Identity(size, size) - scale * mean_ratio.transpose();
  const Eigen::MatrixXd robust = projector * clusteredCovariance() * projector.transpose();
  out.usable = true;
  out.noise_variance = noise_variance_;
  out.poses = poseRows(poseRows(robust).transpose());
  const Eigen::MatrixXd whitened = cholesky_.matrixL().solve(effect);
  const Eigen::MatrixXd pose_effect = poseRows(effect);
  out.own.setZero(patches);
  out.formal.setZero(patches);
  out.pose_effect.setZero(pose_effect.rows(), patches);
  for (Eigen::Index i = 0; i < patches; ++i) {
    const auto sorted = static_cast<std::size_t>(i);
    const auto to = static_cast<Eigen::Index>(order_.patches[sorted]);
    if (!(hessian_[i] > 0)) continue;
    const double redundancy = kPatternSize * observations_[sorted] - 1;
    const double own_variance = static_cast<double>(equations_.energy[sorted]) / redundancy;
    out.own[to] = std::max(noise_variance_, own_variance) / hessian_[i];
    out.formal[to] = noise_variance_ * (1 / hessian_[i] + whitened.col(i).squaredNorm());
    out.pose_effect.col(to) = pose_effect.col(i);
  }
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

std::vector<PatchGradients> hostGradients(const PhotometricProblem& problem,
                                          const PyramidLevel& reference) {
  std::vector<PatchGradients> all(problem.patches.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Eigen::Vector2f& ray = problem.patches[i].ray;
    const auto x =
        static_cast<float>(problem.camera.fx * static_cast<double>(ray.x()) + problem.camera.cx);
    const auto y =
        static_cast<float>(problem.camera.fy * static_cast<double>(ray.y()) + problem.camera.cy);
    for (std::size_t j = 0; j < kPattern.size(); ++j) {
      const ImageSample sample = interpolate(
          reference, x + static_cast<float>(kPattern[j].x), y + static_cast<float>(kPattern[j].y));
      all[i].x[j] = sample.dx;
      all[i].y[j] = sample.dy;
    }
  }
  return all;
}

PhotometricUncertainty estimateUncertainty(const PhotometricProblem& problem,
                                           const PhotometricState& state,
                                           const PyramidLevel& reference,
                                           const PhotometricOptions& options) {
  PhotometricUncertainty out;
  if (problem.patches.empty() || problem.frames.empty()) return out;
  const Evidence evidence(problem, state, options);
  if (!evidence.usable()) return out;
  evidence.fill(state, out);
  const std::vector<PatchGradients> gradients = hostGradients(problem, reference);
  out.speed.resize(static_cast<Eigen::Index>(problem.patches.size()));
  for (std::size_t i = 0; i < problem.patches.size(); ++i) {
    out.speed[static_cast<Eigen::Index>(i)] =
        speedOf(problem.patches[i], gradients[i], problem, state, i);
  }
  return out;
}

namespace {

/// The corners' covariance of some frames' poses, 6 rows each; zero when there is none.
Eigen::MatrixXd geometricCovariance(const InitialMap& map, const std::vector<std::size_t>& frames) {
  std::vector<Eigen::Index> rows(map.frames.size(), -1);
  Eigen::Index size = 0;
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (!map.T_cam_ref[k]) continue;
    rows[k] = size;
    size += 6;
  }
  const auto count = static_cast<Eigen::Index>(frames.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(6 * count, 6 * count);
  if (map.joint_covariance.rows() != size) return covariance;
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) {
      covariance.block<6, 6>(6 * i, 6 * j) = map.joint_covariance.block<6, 6>(
          rows[frames[static_cast<std::size_t>(i)]], rows[frames[static_cast<std::size_t>(j)]]);
    }
  }
  return covariance;
}

}  // namespace

bool setPhotometricVariances(InitialMap& map,
                             const PinholeCamera& camera,
                             const PhotometricOptions& options,
                             bool poses_moved) {
  const std::vector<std::size_t> frames = spreadFrames(map, options.max_frames);
  PhotometricProblem problem = makeProblem(map, camera, frames, 0, options.gradient_weights);
  const PhotometricState state = makeState(problem, map);
  findVisible(problem, state);
  const PhotometricUncertainty u =
      estimateUncertainty(problem, state, map.frames.front()->level(0), options);
  if (!u.usable) return false;
  const Eigen::MatrixXd poses = poses_moved
                                    ? Eigen::MatrixXd(options.pose_variance_factor * u.poses)
                                    : geometricCovariance(map, frames);
  for (std::size_t f = 0; poses_moved && f < frames.size(); ++f) {
    const auto at = static_cast<Eigen::Index>(6 * f);
    map.covariance[frames[f]] = poses.block<6, 6>(at, at);
  }
  const Eigen::MatrixXd spread = poses * u.pose_effect;
  const std::size_t corners = map.corners.size();
  for (std::size_t i = 0; i < problem.patches.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    if (!(u.own[at] > 0) || !(u.speed[at] > 0)) continue;
    const double shift = options.match_error / u.speed[at];
    const double variance = u.own[at] + u.pose_effect.col(at).dot(spread.col(at)) + shift * shift;
    if (problem.source[i] < corners) {
      map.corners[problem.source[i]].variance = variance;
    } else {
      map.points[problem.source[i] - corners].variance = static_cast<float>(variance);
    }
  }
  return true;
}

}  // namespace dsorb::init_orb
