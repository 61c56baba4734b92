// SPDX-License-Identifier: BSD-3-Clause
#include "self_calibration/camera_adjustment.h"

#include "estimate/levenberg_marquardt.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace dsorb::self_calibration {
namespace {

using Eigen::Index;
using Matrix23 = Eigen::Matrix<double, 2, 3>;
constexpr int kPoseDim = 6;
constexpr int kViewDim = 8;  // pose and shift
using Matrix2V = Eigen::Matrix<double, 2, kViewDim>;

constexpr double kLossScale = 4;  // squared standard deviations at which the loss bends
constexpr double kBehind = 50;    // loss of a corner behind a view that sees it
constexpr double kFirstDamping = 1e-6;
constexpr double kLeastDamping = 1e-8;  // holds the motions and scales of whole worlds
constexpr double kZoomSigma = 0.3;      // wide: a change of the focal length is nearly free
constexpr double kLeastChange = 1e-4;   // of the cost; less ends an adjustment

/// Error of a sight with its derivatives.
struct Residual {
  bool in_front = false;
  Eigen::Vector2d error;
  Matrix2V by_view;
  Matrix23 by_corner;
  Eigen::Matrix<double, 2, kLensDim> by_lens;
};

/// Place of a view between the first and the last, -1/2 to 1/2.
double phaseOf(const Scene& scene, std::size_t view) {
  const auto last = static_cast<double>(std::max<std::size_t>(scene.views.size(), 2) - 1);
  return static_cast<double>(view) / last - 0.5;
}

/// fx and fy of a view [px].
Eigen::Vector2d focalOf(const Scene& scene, std::size_t view) {
  const double log_fx = scene.lens[kLogFocal] + phaseOf(scene, view) * scene.lens[kZoom];
  return {std::exp(log_fx), std::exp(log_fx + scene.lens[kAspect])};
}

/// What the distance of a ray from the axis is multiplied by, at the square of that distance.
double bendAt(const LensVector& lens, double squared) {
  return 1 +
         squared * (lens[kRadial] + squared * (lens[kRadial + 1] + squared * lens[kRadial + 2]));
}

/// @tparam Derivatives whether they are wanted
template <bool Derivatives>
Residual residualOf(const Scene& scene, const Sight& sight) {
  Residual r;
  const SE3& view = scene.views[sight.view];
  const Eigen::Vector3d p = view * scene.corners[sight.corner];
  r.in_front = p.z() > 1e-6 * p.norm();
  if (!r.in_front) return r;
  const Eigen::Vector2d focal = focalOf(scene, sight.view);
  const Eigen::Vector2d ray = p.head<2>() / p.z();
  const double squared = ray.squaredNorm();
  const auto k = scene.lens.segment<3>(kRadial);
  const double bend = bendAt(scene.lens, squared);
  const Eigen::Vector2d shift = bend * focal.cwiseProduct(ray);
  r.error = shift + scene.lens.segment<2>(kCenter) + scene.shifts[sight.view] - sight.pixel +
            scene.lens[kReadout] * sight.drift;
  if constexpr (!Derivatives) return r;
  const Eigen::Matrix2d by_ray =
      focal.asDiagonal() *
      (bend * Eigen::Matrix2d::Identity() +
       2 * (k[0] + squared * (2 * k[1] + 3 * squared * k[2])) * ray * ray.transpose());
  Matrix23 ray_by_point;
  ray_by_point << 1, 0, -ray.x(), 0, 1, -ray.y();
  const Matrix23 by_point = by_ray * ray_by_point / p.z();
  r.by_corner = by_point * view.rotationMatrix();
  r.by_view << by_point, -by_point * hat(p), Eigen::Matrix2d::Identity();
  r.by_lens.col(kLogFocal) = shift;
  r.by_lens.middleCols<2>(kCenter).setIdentity();
  r.by_lens.col(kRadial) = squared * focal.cwiseProduct(ray);
  r.by_lens.col(kRadial + 1) = squared * r.by_lens.col(kRadial);
  r.by_lens.col(kRadial + 2) = squared * r.by_lens.col(kRadial + 1);
  r.by_lens.col(kReadout) = sight.drift;
  r.by_lens.col(kZoom) = phaseOf(scene, sight.view) * shift;
  r.by_lens.col(kAspect) << 0, shift.y();
  return r;
}

double lossOf(double squared) {
  return kLossScale * std::log1p(squared / kLossScale);
}

double costOf(const Scene& scene, const LensPrior& prior, double noise) {
  double cost = 0;
  for (const Sight& sight : scene.sights) {
    const Residual r = residualOf<false>(scene, sight);
    cost += r.in_front ? lossOf(r.error.squaredNorm() / (noise * noise)) : kBehind;
  }
  if (prior.shift_sigma > 0) {
    for (const Eigen::Vector2d& shift : scene.shifts)
      cost += shift.squaredNorm() / (prior.shift_sigma * prior.shift_sigma);
  }
  for (int i = 0; i < kLensDim; ++i) {
    if (prior.sigma[i] > 0) cost += std::pow((scene.lens[i] - prior.mean[i]) / prior.sigma[i], 2);
  }
  return cost;
}

/// The sights of a corner: [first, last).
struct SightRange {
  std::size_t first = 0;
  std::size_t last = 0;
};

std::vector<SightRange> rangesOf(const Scene& scene) {
  std::vector<SightRange> ranges(scene.corners.size());
  for (std::size_t i = 0; i < scene.sights.size(); ++i) {
    SightRange& range = ranges[scene.sights[i].corner];
    if (range.last == 0) range.first = i;
    range.last = i + 1;
  }
  return ranges;
}

/// A corner, eliminated: its step is -(gradient + coupling * step of lens and of its views).
struct EliminatedCorner {
  std::size_t first = 0;      // of its sights
  std::vector<Index> rows;    // of the blocks of its views
  Eigen::Matrix3Xd C;         // of the corner with the lens, then with its views
  Eigen::Matrix3Xd coupling;  // H^-1 C
  Eigen::Vector3d gradient;   // H^-1 b
};

/// Equations of lens and views, corners eliminated: the lens first.
struct Reduced {
  Eigen::MatrixXd H;  // lower half
  Eigen::VectorXd b;
  Eigen::VectorXd diagonal;  // of H before corners were eliminated
  std::vector<EliminatedCorner> corners;
};

/// Row and column of the first unknown of a view, behind those of the lens.
Index rowOf(std::size_t view) {
  return kLensDim + kViewDim * static_cast<Index>(view);
}

/// Sums what one sight says of lens and view.
void addSight(const Residual& r, double w, Index row, Reduced& system) {
  const Eigen::Matrix<double, kLensDim, kLensDim> lens = w * r.by_lens.transpose() * r.by_lens;
  const Eigen::Matrix<double, kViewDim, kViewDim> view = w * r.by_view.transpose() * r.by_view;
  system.H.topLeftCorner<kLensDim, kLensDim>() += lens;
  system.H.block<kViewDim, kLensDim>(row, 0).noalias() += w * r.by_view.transpose() * r.by_lens;
  system.H.block<kViewDim, kViewDim>(row, row) += view;
  system.diagonal.head<kLensDim>() += lens.diagonal();
  system.diagonal.segment<kViewDim>(row) += view.diagonal();
  system.b.head<kLensDim>().noalias() += w * r.by_lens.transpose() * r.error;
  system.b.segment<kViewDim>(row).noalias() += w * r.by_view.transpose() * r.error;
}

/// Sums what the sights of one corner say, and finds how it follows lens and views.
EliminatedCorner addCorner(
    const Scene& scene, const SightRange& range, double noise, double damping, Reduced& system) {
  EliminatedCorner corner;
  corner.first = range.first;
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  corner.C = Eigen::Matrix3Xd::Zero(3, rowOf(range.last - range.first));
  const double information = 1 / (noise * noise);
  for (std::size_t i = range.first; i < range.last; ++i) {
    const Sight& sight = scene.sights[i];
    corner.rows.push_back(rowOf(sight.view));
    const Residual r = residualOf<true>(scene, sight);
    if (!r.in_front) continue;
    const double w = information / (1 + information * r.error.squaredNorm() / kLossScale);
    H += w * r.by_corner.transpose() * r.by_corner;
    b += w * r.by_corner.transpose() * r.error;
    corner.C.leftCols<kLensDim>() += w * r.by_corner.transpose() * r.by_lens;
    corner.C.middleCols<kViewDim>(rowOf(i - range.first)) = w * r.by_corner.transpose() * r.by_view;
    addSight(r, w, corner.rows.back(), system);
  }
  H.diagonal() *= 1 + damping;
  H.diagonal().array() += 1e-12 * H.trace() + 1e-300;
  const Eigen::LLT<Eigen::Matrix3d> factor(H);
  corner.coupling = factor.solve(corner.C);
  corner.gradient = factor.solve(b);
  return corner;
}

/// Takes the part of an eliminated corner out of the rows of lens and views.
/// @tparam Used number of unknowns of a view; those behind them are held
template <Index Used>
void subtractCorner(const EliminatedCorner& corner, Reduced& system) {
  const auto& Y = corner.coupling;
  const auto lens = corner.C.leftCols<kLensDim>();
  system.H.topLeftCorner<kLensDim, kLensDim>().noalias() -=
      lens.transpose() * Y.leftCols<kLensDim>();
  system.b.head<kLensDim>().noalias() -= lens.transpose() * corner.gradient;
  for (std::size_t a = 0; a < corner.rows.size(); ++a) {
    const auto view = corner.C.middleCols<Used>(rowOf(a));
    const Index row = corner.rows[a];
    system.b.segment<Used>(row).noalias() -= view.transpose() * corner.gradient;
    system.H.block<Used, kLensDim>(row, 0).noalias() -= view.transpose() * Y.leftCols<kLensDim>();
    for (std::size_t c = 0; c < corner.rows.size(); ++c) {
      if (corner.rows[c] > row) continue;
      system.H.block<Used, Used>(row, corner.rows[c]).noalias() -=
          view.transpose() * Y.middleCols<Used>(rowOf(c));
    }
  }
}

Reduced linearize(const Scene& scene, const LensPrior& prior, double noise, double damping) {
  const std::vector<SightRange> ranges = rangesOf(scene);
  const Index size = rowOf(scene.views.size());
  Reduced system{Eigen::MatrixXd::Zero(size, size),
                 Eigen::VectorXd::Zero(size),
                 Eigen::VectorXd::Zero(size),
                 {}};
  system.corners.reserve(ranges.size());
  const auto subtract =
      prior.shift_sigma > 0 ? &subtractCorner<kViewDim> : &subtractCorner<kPoseDim>;
  for (const SightRange& range : ranges) {
    system.corners.push_back(addCorner(scene, range, noise, damping, system));
    subtract(system.corners.back(), system);
  }
  system.H.diagonal() += damping * system.diagonal;
  const auto constrain = [&system](Index row, double sigma, double deviation) {
    if (sigma > 0) {
      system.H(row, row) += 1 / (sigma * sigma);
      system.b[row] += deviation / (sigma * sigma);
      return;
    }
    system.H.row(row).setZero();
    system.H.col(row).setZero();
    system.H(row, row) = 1;
    system.b[row] = 0;
  };
  for (Index i = 0; i < kLensDim; ++i) {
    constrain(i, prior.sigma[i], scene.lens[i] - prior.mean[i]);
  }
  for (std::size_t i = 0; i < scene.views.size(); ++i) {
    for (const Index k : {0, 1}) {
      constrain(rowOf(i) + kPoseDim + k, prior.shift_sigma, scene.shifts[i][k]);
    }
  }
  return system;
}

/// Rows and columns of a symmetric system made comparable.
class ScaledSystem {
 public:
  explicit ScaledSystem(const Eigen::MatrixXd& lower)
      : scale_((lower.diagonal().array().abs() + 1e-12).rsqrt()) {
    const Eigen::MatrixXd scaled = scale_.asDiagonal() * lower * scale_.asDiagonal();
    factor_.compute(scaled.selfadjointView<Eigen::Lower>());
  }
  [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const {
    return scale_.asDiagonal() * factor_.solve(scale_.asDiagonal() * b);
  }

 private:
  Eigen::VectorXd scale_;
  Eigen::LDLT<Eigen::MatrixXd> factor_;
};

/// Where a pinhole camera with a global shutter would see a corner, on the plane z = 1.
Eigen::Vector2d rayOf(const Scene& scene, const Sight& sight) {
  constexpr int kIterations = 10;
  constexpr double kLeastBend = 0.3;
  const Eigen::Vector2d pixel =
      sight.pixel - scene.shifts[sight.view] - scene.lens[kReadout] * sight.drift;
  const Eigen::Vector2d seen =
      (pixel - scene.lens.segment<2>(kCenter)).cwiseQuotient(focalOf(scene, sight.view));
  Eigen::Vector2d ray = seen;
  for (int i = 0; i < kIterations; ++i) {
    ray = seen / std::max(bendAt(scene.lens, ray.squaredNorm()), kLeastBend);
  }
  return ray;
}

/// For minimize().
class AdjustmentProblem {
 public:
  AdjustmentProblem(const LensPrior& prior, double noise, Scene& scene)
      : prior_(prior), noise_(noise), scene_(scene), cost_(costOf(scene, prior, noise)) {}

  [[nodiscard]] double cost() const { return cost_; }
  std::optional<double> solve(double damping) {
    system_ = linearize(scene_, prior_, noise_, damping);
    step_ = -ScaledSystem(system_.H).solve(system_.b);
    return step_.allFinite() ? std::optional(0.0) : std::nullopt;
  }
  std::optional<double> tryStep() {
    moved_ = scene_;
    moved_.lens += step_.head<kLensDim>();
    for (std::size_t i = 0; i < moved_.views.size(); ++i) {
      moved_.views[i] = SE3::exp(step_.segment<kPoseDim>(rowOf(i))) * moved_.views[i];
      moved_.shifts[i] += step_.segment<2>(rowOf(i) + kPoseDim);
    }
    for (std::size_t i = 0; i < moved_.corners.size(); ++i) {
      moved_.corners[i] = movedCorner(i, system_.corners[i]);
    }
    moved_cost_ = costOf(moved_, prior_, noise_);
    return moved_cost_ < cost_ ? std::optional(cost_ - moved_cost_) : std::nullopt;
  }
  bool accept(const DampedStep& step) {
    const bool converged = *step.decrease < kLeastChange * cost_;
    std::swap(scene_, moved_);
    cost_ = moved_cost_;
    return !converged;
  }
  [[nodiscard]] static bool reject(const DampedStep& /*step*/) { return true; }

 private:
  /// A corner where the step wants its pixel and its inverse depth in the view that sees it first:
  /// the other views' pixels are nearly linear in these, and not in its position.
  [[nodiscard]] Eigen::Vector3d movedCorner(std::size_t index,
                                            const EliminatedCorner& corner) const {
    constexpr double kLeastShare = 0.1;  // of an inverse depth
    if (corner.rows.empty()) return scene_.corners[index];
    Eigen::Vector3d step =
        -corner.gradient - corner.coupling.leftCols<kLensDim>() * step_.head<kLensDim>();
    for (std::size_t k = 0; k < corner.rows.size(); ++k) {
      step -=
          corner.coupling.middleCols<kViewDim>(rowOf(k)) * step_.segment<kViewDim>(corner.rows[k]);
    }
    const Eigen::Vector3d& before = scene_.corners[index];
    Sight sight = scene_.sights[corner.first];
    const Residual r = residualOf<true>(scene_, sight);
    if (!r.in_front) return before + step;
    sight.pixel += r.error + r.by_lens * step_.head<kLensDim>() +
                   r.by_view * step_.segment<kViewDim>(corner.rows.front()) + r.by_corner * step;
    const SE3& view = moved_.views[sight.view];
    const double z = (scene_.views[sight.view] * before).z();
    const double share = 2 - (view * (before + step)).z() / z;  // of the inverse depth
    const Eigen::Vector3d ray = rayOf(moved_, sight).homogeneous();
    return view.inverse() * (z / std::max(share, kLeastShare) * ray);
  }

  const LensPrior& prior_;
  double noise_;
  Scene& scene_;
  double cost_;
  Scene moved_;
  double moved_cost_ = 0;
  Reduced system_;
  Eigen::VectorXd step_;
};

/// Keeps the corners that are marked, with their sights.
void keepOnly(const std::vector<char>& kept, Scene& scene) {
  std::vector<std::size_t> place(kept.size());
  std::vector<Eigen::Vector3d> corners;
  for (std::size_t i = 0; i < kept.size(); ++i) {
    place[i] = corners.size();
    if (kept[i] != 0) corners.push_back(scene.corners[i]);
  }
  std::vector<Sight> sights;
  for (Sight sight : scene.sights) {
    if (kept[sight.corner] == 0) continue;
    sight.corner = place[sight.corner];
    sights.push_back(sight);
  }
  scene.corners = std::move(corners);
  scene.sights = std::move(sights);
}

}  // namespace

void placeCorners(Scene& scene) {
  scene.shifts.resize(scene.views.size(), Eigen::Vector2d::Zero());
  std::vector<Eigen::Matrix3d> H(scene.corners.size(), Eigen::Matrix3d::Zero());
  std::vector<Eigen::Vector3d> b(scene.corners.size(), Eigen::Vector3d::Zero());
  for (const Sight& sight : scene.sights) {
    const SE3& view = scene.views[sight.view];
    const Eigen::Matrix3d R = view.rotationMatrix();
    const Eigen::Vector2d ray = rayOf(scene, sight);
    for (Index i = 0; i < 2; ++i) {  // (row i - ray_i row 3) [X; 1] = 0
      const Eigen::Vector3d row = (R.row(i) - ray[i] * R.row(2)).transpose();
      const double right = ray[i] * view.translation().z() - view.translation()[i];
      H[sight.corner] += row * row.transpose();
      b[sight.corner] += row * right;
    }
  }
  for (std::size_t i = 0; i < H.size(); ++i) {
    H[i].diagonal().array() += 1e-9 * H[i].trace();
    scene.corners[i] = H[i].ldlt().solve(b[i]);
  }
  leaveOutAbove(std::numeric_limits<double>::max(), scene);
}

std::vector<double> sightErrors(const Scene& scene) {
  std::vector<double> errors;
  errors.reserve(scene.sights.size());
  for (const Sight& sight : scene.sights) {
    const Residual r = residualOf<false>(scene, sight);
    errors.push_back(r.in_front ? r.error.norm() : std::numeric_limits<double>::infinity());
  }
  return errors;
}

void leaveOutAbove(double limit, Scene& scene) {
  const std::vector<double> errors = sightErrors(scene);
  std::vector<char> kept(scene.corners.size(), 1);
  for (std::size_t i = 0; i < errors.size(); ++i) {
    if (!(errors[i] <= limit)) kept[scene.sights[i].corner] = 0;
  }
  keepOnly(kept, scene);
}

double adjust(const LensPrior& prior, double noise, int max_iterations, Scene& scene) {
  scene.shifts.resize(scene.views.size(), Eigen::Vector2d::Zero());
  AdjustmentProblem problem(prior, noise, scene);
  FactorDamping damping{kFirstDamping, 0.2, 5, kLeastDamping, kLeastDamping, 1e8, 8};
  minimize(problem, damping, max_iterations);
  return problem.cost();
}

LensVector lensSigmas(const LensPrior& prior, double noise, const Scene& scene) {
  const ScaledSystem system(linearize(scene, prior, noise, kLeastDamping).H);
  LensVector sigmas = LensVector::Zero();
  const Index size = rowOf(scene.views.size());
  for (Index i = 0; i < kLensDim; ++i) {
    if (!(prior.sigma[i] > 0)) continue;
    sigmas[i] = std::sqrt(std::max(0.0, system.solve(Eigen::VectorXd::Unit(size, i))[i]));
  }
  return sigmas;
}

FocalChange focalChange(LensPrior prior, double noise, int max_iterations, Scene scene) {
  prior.sigma[kZoom] = kZoomSigma;
  adjust(prior, noise, max_iterations, scene);
  return {scene.lens[kZoom], lensSigmas(prior, noise, scene)[kZoom]};
}

ViewShifts viewShifts(
    LensPrior prior, double noise, double sigma, int max_iterations, Scene scene) {
  const double cost = costOf(scene, prior, noise);
  const double focal = scene.lens[kLogFocal];
  prior.shift_sigma = sigma;
  const double gain = cost - adjust(prior, noise, max_iterations, scene);
  double squared = 0;
  for (const Eigen::Vector2d& shift : scene.shifts) squared += shift.squaredNorm();
  const auto views = static_cast<double>(scene.views.size());
  return {std::sqrt(squared / views), gain / views, scene.lens[kLogFocal] - focal};
}

}  // namespace dsorb::self_calibration
