// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/camera/row_times.h"

#include "base/random.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "support/synthetic_map.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <vector>

namespace dsorb::init_orb {
namespace {

/// Motion of a quick hand.
RowMotion someMotion(Random& random) {
  RowMotion motion;
  for (int i = 0; i < 6; ++i) {
    motion.velocity[i] = random.uniform(-0.3, 0.3);
    motion.acceleration[i] = random.uniform(-3, 3);
  }
  return motion;
}

FramePtr rollingFrame(std::size_t k, const PinholeCamera& camera) {
  static const std::vector<std::uint8_t> kGrey(std::size_t{640} * 480, 100);
  Lens lens{LensModel::kPinhole, camera.fx, camera.fy, camera.cx, camera.cy, {}, 640, 480};
  lens.readout = {0.025, 0};
  const auto rows = std::make_shared<const RowTimes>(rowTimes(lens, camera, false));
  const auto index = static_cast<int>(k);
  return Frame::create({kGrey.data(), 640, 480}, {FrameId{index}, index / 30.0, 1, nullptr, rows});
}

/// A map as a rolling shutter saw it.
struct RollingMap {
  SyntheticMap scene;
  std::vector<RowMotion> motions;            // true ones
  std::vector<Eigen::Vector2f> rows;         // pixels of the observations in their rows
  std::vector<double> target_inverse_depth;  // of the same
};

RollingMap makeRollingMap(double perturbation) {
  RollingMap made{makeSyntheticMap({301, 5, 0, perturbation}, 5), {}, {}, {}};
  Random random(6);
  InitialMap& truth = made.scene.truth;
  InitialMap& start = made.scene.start;
  const PinholeCamera& camera = made.scene.camera;
  for (std::size_t k = 0; k < truth.frames.size(); ++k) {
    truth.frames[k].frame = start.frames[k].frame = rollingFrame(k, camera);
    made.motions.push_back(someMotion(random));
  }
  for (const RowMotion& motion : made.motions) truth.motions.push_back({motion});
  for (std::size_t i = 0; i < truth.corners.size(); ++i) {
    const auto rho = static_cast<float>(truth.corners[i].inverse_depth);
    const Eigen::Vector2f pixel = truth.corners[i].pixel.cast<float>();
    start.corners[i].shift =
        pixelInRow(*shutterOf(truth, 0), camera, pixel, rho).cast<double>() - pixel.cast<double>();
  }
  for (const CornerObservation& exact : truth.observations) {
    const Corner& corner = truth.corners[exact.corner];
    const Eigen::Vector3d point = camera.unproject(corner.pixel) / corner.inverse_depth;
    const double rho = 1 / (*truth.frames[exact.frame].T_cam_ref * point).z();
    made.target_inverse_depth.push_back(rho);
    made.rows.push_back(pixelInRow(*shutterOf(truth, exact.frame),
                                   camera,
                                   exact.pixel.cast<float>(),
                                   static_cast<float>(rho)));
  }
  return made;
}

/// The perturbed map, its pixels moved to the middle rows with some motions.
InitialMap mapWith(const RollingMap& made, const std::vector<RowMotion>& motions) {
  InitialMap map = made.scene.start;
  for (std::size_t k = 0; k < motions.size(); ++k) {
    map.motions.push_back(
        {motions[k], {made.motions[k], Vector6d::Constant(3), Vector6d::Constant(30)}});
  }
  placeCorners(map, made.scene.camera);
  for (std::size_t i = 0; i < map.observations.size(); ++i) {
    CornerObservation& observation = map.observations[i];
    observation.pixel = pixelInMiddle(*shutterOf(map, observation.frame),
                                      made.scene.camera,
                                      made.rows[i],
                                      static_cast<float>(made.target_inverse_depth[i]))
                            .cast<double>();
  }
  return map;
}

std::vector<RowMotion> wrongMotions(const RollingMap& made) {
  std::vector<RowMotion> wrong = made.motions;
  Random random(7);
  for (RowMotion& motion : wrong) {
    const RowMotion other = someMotion(random);
    motion.velocity += other.velocity;
    motion.acceleration += other.acceleration;
  }
  return wrong;
}

GeometricOptions rollingOptions() {
  GeometricOptions options;
  options.sigma = 0.1;
  return options;
}

/// Largest difference of the velocities [unit/s; rad/s].
double velocityError(const InitialMap& map, const std::vector<RowMotion>& truth) {
  double largest = 0;
  for (std::size_t k = 0; k < truth.size(); ++k) {
    largest = std::max(largest,
                       (map.motions[k].found.velocity - truth[k].velocity).cwiseAbs().maxCoeff());
  }
  return largest;
}

double poseError(const InitialMap& map, const InitialMap& truth) {
  double largest = 0;
  for (std::size_t k = 1; k < truth.frames.size(); ++k) {
    const SE3 off = *map.frames[k].T_cam_ref * truth.frames[k].T_cam_ref->inverse();
    largest = std::max(largest, off.log().norm());
  }
  return largest;
}

TEST(RollingEquations, GradientByMotionsIsTheNumericOne) {
  const RollingMap made = makeRollingMap(0.01);
  const PinholeCamera& camera = made.scene.camera;
  const GeometricOptions options = rollingOptions();
  const InitialMap map = mapWith(made, made.motions);
  const UnknownRows rows(map);
  const ReprojectionEquations equations = linearize(map, rows, camera, options);
  const auto cost = [&](std::size_t frame, Eigen::Index entry, double change) {
    std::vector<RowMotion> motions = made.motions;
    Vector6d& changed = entry < 6 ? motions[frame].velocity : motions[frame].acceleration;
    changed[entry % 6] += change;
    return linearize(mapWith(made, motions), rows, camera, options).cost;
  };
  for (const std::size_t frame : {std::size_t{0}, std::size_t{1}, std::size_t{4}}) {
    const int row = frame == 0 ? rows.motionOfReference() : rows.motion(rows.first[frame]);
    Eigen::VectorXd expected(12);
    for (Eigen::Index i = 0; i < 12; ++i) {
      const double step = i < 6 ? 0.02 : 2;  // far above the single precision of the pixels
      expected[i] = (cost(frame, i, step) - cost(frame, i, -step)) / (2 * step);
    }
    const Eigen::VectorXd made_of = equations.system.b.segment<12>(row);
    // First order in the motion, times of the rows fixed. Measured: at most 5.1 % and 2.9 %.
    EXPECT_LT((made_of - expected).head<6>().norm(), 0.08 * expected.head<6>().norm()) << frame;
    EXPECT_LT((made_of - expected).tail<6>().norm(), 0.08 * expected.tail<6>().norm()) << frame;
  }
}

TEST(RollingEquations, SolutionFindsPosesAndMotionsThatAGlobalShutterMisses) {
  const RollingMap made = makeRollingMap(0);
  const PinholeCamera& camera = made.scene.camera;
  InitialMap rolling = mapWith(made, wrongMotions(made));
  InitialMap global = rolling;
  global.motions.clear();
  const double before = velocityError(rolling, made.motions);
  ASSERT_TRUE(solveGeometry(global, camera, rollingOptions()));
  ASSERT_TRUE(solveGeometry(rolling, camera, rollingOptions()));
  // Measured: 3e-5 instead of 4e-3, and 0.011 instead of 0.28.
  EXPECT_LT(poseError(rolling, made.scene.truth), 0.05 * poseError(global, made.scene.truth));
  EXPECT_LT(velocityError(rolling, made.motions), 0.1 * before);
}

TEST(RollingEquations, KnownDepthsTakePart) {
  const RollingMap made = makeRollingMap(0.01);
  InitialMap map = mapWith(made, made.motions);
  const UnknownRows rows(map);
  const auto linearized = [&] { return linearize(map, rows, made.scene.camera, rollingOptions()); };
  const ReprojectionEquations without = linearized();
  map.metres = 1;
  map.corners[3].known = {map.corners[3].inverse_depth + 0.01, 1e-4};
  const ReprojectionEquations with = linearized();
  const KnownTerm term = knownTerm(map.corners[3].known, map.corners[3].inverse_depth);
  EXPECT_DOUBLE_EQ(with.system.depth_hessian[3], without.system.depth_hessian[3] + term.hessian);
  EXPECT_DOUBLE_EQ(with.system.depth_gradient[3], without.system.depth_gradient[3] + term.gradient);
  EXPECT_NEAR(with.cost, without.cost + term.cost, 1e-9 * with.cost);
  EXPECT_EQ(with.rows, without.rows + 1);
}

TEST(RollingEquations, MarginalsOfPosesAreWiderThanThoseWithKnownMotions) {
  const RollingMap made = makeRollingMap(0);
  InitialMap map = mapWith(made, made.motions);
  const GeometricMarginals unknown(map, made.scene.camera, rollingOptions());
  for (FrameMotion& motion : map.motions) {
    motion.prior.sigma.setConstant(1e-4);
    motion.prior.acceleration_sigma.setConstant(1e-3);
  }
  const GeometricMarginals known(map, made.scene.camera, rollingOptions());
  map.motions.clear();
  const GeometricMarginals global(map, made.scene.camera, rollingOptions());
  const auto variances = [&](const GeometricMarginals& found) {
    const Eigen::MatrixXd roots = found.marginals.inGauge(found.marginals.roots());
    return Eigen::VectorXd(roots.rowwise().squaredNorm().head(global.rows.poses));
  };
  ASSERT_TRUE(unknown.marginals.usable() && known.marginals.usable());
  EXPECT_GT((variances(unknown).array() / variances(known).array()).minCoeff(), 1);
  // Known motions are a global shutter's. Measured: 0.8 %.
  EXPECT_LT((variances(known).array() / variances(global).array() - 1).abs().maxCoeff(), 2e-2);
}

}  // namespace
}  // namespace dsorb::init_orb
