// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/rival_motions.h"

#include "base/angles.h"
#include "base/parallel.h"
#include "geometry/tangent_basis.h"
#include "init/orb/two_view/motion_refinement.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr double kFreedom = 4;         // of the t-distribution of a match
constexpr int kDirections = 100;       // over half a sphere: 15 degrees apart
constexpr std::size_t kGrain = 8;      // directions one thread takes at a time
constexpr int kIterations = 4;         // of the rotation, for each of them
constexpr int kRefined = 3;            // best ones, whose direction is then adjusted as well
constexpr std::size_t kMatches = 200;  // evenly taken from all
constexpr double kMaxTurn = 0.1;       // of a rotation in one step [rad]

/// Matches that take part, with the scale of their errors.
struct Sample {
  Matches matches;
  std::vector<Eigen::Vector3d> reference;
  std::vector<Eigen::Vector3d> target;
  double inverse_sigma = 1;  ///< in normalised units
};

Sample sampleOf(const Matches& matches, const PinholeCamera& camera, double sigma) {
  Sample sample;
  sample.inverse_sigma = camera.fx / sigma;
  const std::size_t step = std::max<std::size_t>(1, matches.size() / kMatches);
  for (std::size_t i = 0; i < matches.size(); i += step) {
    sample.matches.reference.push_back(matches.reference[i]);
    sample.matches.target.push_back(matches.target[i]);
    sample.reference.push_back(camera.unproject(matches.reference[i]));
    sample.target.push_back(camera.unproject(matches.target[i]));
  }
  return sample;
}

/// Negative log likelihood but for a constant, with the equations of the rotation.
struct RotationEquations {
  double cost = 0;
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
};

RotationEquations linearize(const SE3& T_cur_ref, const Sample& sample) {
  const Eigen::Matrix<double, 3, 2> basis = tangentBasis(T_cur_ref.translation());
  const double information = sample.inverse_sigma * sample.inverse_sigma;
  RotationEquations equations;
  double product = 1;  // of the ratios, whose logarithms are the costs
  for (std::size_t i = 0; i < sample.reference.size(); ++i) {
    const EpipolarResidual residual =
        epipolarResidual(T_cur_ref, sample.reference[i], sample.target[i], basis);
    const double ratio = 1 + residual.value * residual.value * information / kFreedom;
    product *= ratio;
    if (product > 1e200) {
      equations.cost += std::log(product);
      product = 1;
    }
    const Eigen::Vector3d J = residual.J.head<3>().transpose();
    equations.H += J * J.transpose() / ratio;
    equations.b -= J * (residual.value / ratio);
  }
  equations.cost = (kFreedom + 1) / 2 * (equations.cost + std::log(product));
  return equations;
}

/// A few bounded steps that are never refused, unlike minimize()'s: all directions are ranked by
/// the cost in the end.
SE3 fitRotation(SE3 T_cur_ref, const Sample& sample) {
  for (int i = 0; i < kIterations; ++i) {
    const RotationEquations equations = linearize(T_cur_ref, sample);
    Eigen::Vector3d step = equations.H.ldlt().solve(equations.b);
    if (!step.allFinite()) break;
    if (step.norm() > kMaxTurn) step *= kMaxTurn / step.norm();
    T_cur_ref = SE3(so3Exp(step) * T_cur_ref.unitQuaternion(), T_cur_ref.translation());
  }
  return T_cur_ref;
}

/// Between two lines.
double lineAngleDeg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return kDegPerRad * std::atan2(a.cross(b).norm(), std::abs(a.dot(b)));
}

/// The k-th of kDirections points of half a sphere, evenly spread.
/// @source Gonzalez, Measurement of Areas on a Sphere Using Fibonacci and Latitude-Longitude
///         Lattices, 2010
Eigen::Vector3d direction(int k) {
  const double golden = M_PI * (3 - std::sqrt(5.0));
  const double z = (k + 0.5) / kDirections;
  const double radius = std::sqrt(1 - z * z);
  return {radius * std::cos(golden * k), radius * std::sin(golden * k), z};
}

}  // namespace

RivalMotion findRival(const SE3& T_cur_ref,
                      const Matches& matches,
                      const PinholeCamera& camera,
                      double sigma,
                      double angle_deg) {
  const Sample sample = sampleOf(matches, camera, sigma);
  const SE3 own(T_cur_ref.unitQuaternion(), T_cur_ref.translation().normalized());
  RivalMotion rival;
  rival.excess = std::numeric_limits<double>::infinity();
  rival.matches = static_cast<int>(sample.target.size());
  const double own_cost = linearize(own, sample).cost;
  std::vector<SE3> fitted(kDirections);
  std::vector<double> excess(kDirections);
  forEachRange(fitted.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      fitted[k] = fitRotation(SE3(own.unitQuaternion(), direction(static_cast<int>(k))), sample);
      excess[k] = linearize(fitted[k], sample).cost - own_cost;
    }
  });
  std::vector<std::pair<double, SE3>> found;
  const auto consider = [&](const SE3& motion, double its_excess) {
    if (lineAngleDeg(motion.translation(), own.translation()) < angle_deg) return;
    rival.excess = std::min(rival.excess, its_excess);
    found.emplace_back(its_excess, motion);
  };
  for (std::size_t k = 0; k < fitted.size(); ++k) consider(fitted[k], excess[k]);
  const auto better = [](const auto& a, const auto& b) { return a.first < b.first; };
  std::stable_sort(found.begin(), found.end(), better);
  found.resize(std::min<std::size_t>(kRefined, found.size()));
  const std::vector<char> all(sample.matches.size(), 1);
  for (const auto& start : std::vector(found)) {
    const SE3 refined = refineMotion(start.second, sample.matches, all, camera, 2 * sigma);
    consider(refined, linearize(refined, sample).cost - own_cost);
  }
  std::stable_sort(found.begin(), found.end(), better);
  for (const auto& candidate : found) {
    const Eigen::Vector3d& heading = candidate.second.translation();
    const bool known =
        std::any_of(rival.motions.begin(), rival.motions.end(), [&](const SE3& other) {
          return lineAngleDeg(heading, other.translation()) < angle_deg;
        });
    if (!known) rival.motions.push_back(candidate.second);
  }
  return rival;
}

}  // namespace dsorb::init_orb
