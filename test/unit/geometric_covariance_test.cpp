// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/geometric_covariance.h"

#include "base/median.h"
#include "published/bundle_adjustment.h"
#include "support/assign_map.h"
#include "support/formal_covariance.h"
#include "support/jacobian_check.h"
#include "support/matchers.h"
#include "support/synthetic_map.h"

#include <Eigen/Eigenvalues>
#include <ceres/covariance.h>
#include <ceres/problem.h>
#include <gtest/gtest.h>

#include <deque>
#include <memory>
#include <optional>
#include <utility>

namespace dsorb::init_orb {
namespace {

TEST(GeometricCovariance, VariancesPredictTheErrorsOfNoisyObservations) {
  std::vector<double> depth_ratios;
  std::vector<double> pose_ratios;
  for (std::uint64_t seed = 10; seed < 30; ++seed) {
    SyntheticMap scene = makeSyntheticMap({200, 4, 0.3, 0.1}, seed);
    const auto factor = adjust(scene.start, scene.camera, huber());
    ASSERT_TRUE(factor);
    setFormalCovariances(scene.start, scene.camera, huber());
    ASSERT_EQ(scene.start.corners.size(), scene.truth.corners.size());
    EXPECT_NEAR(*factor, 0.09, 0.02);  // noise^2; 800 degrees of freedom: 5 %
    // Truth in the gauge of the estimate: its noise moved the mean inverse depth.
    for (std::size_t i = 0; i < scene.truth.corners.size(); ++i) {
      const Corner& corner = scene.start.corners[i];
      const double error = corner.inverse_depth - scene.truth.corners[i].inverse_depth;
      depth_ratios.push_back(error * error / corner.variance);
    }
    const Vector6d error =
        (*scene.truth.frames[3].T_cam_ref * scene.start.frames[3].T_cam_ref->inverse()).log();
    pose_ratios.push_back(error.dot(scene.start.frames[3].covariance->inverse() * error) / 6);
  }
  // Medians expected: 0.455 for chi-square 1, 0.891 for chi-square 6 over 6.
  EXPECT_NEAR(medianOf(depth_ratios), 0.455, 0.1);
  EXPECT_NEAR(medianOf(pose_ratios), 0.891, 0.35);
}

/// Covariance of all parameters [poses; inverse depths] by the pseudo-inverse of the whole Hessian
/// (numeric Jacobians), moved to the gauge "mean inverse depth fixed".
Eigen::MatrixXd denseCovariance(const InitialMap& map, const PinholeCamera& camera) {
  const auto poses = static_cast<Eigen::Index>(6 * (map.frames.size() - 1));
  const auto corners = static_cast<Eigen::Index>(map.corners.size());
  const auto residuals = [&](const Eigen::VectorXd& delta) {
    Eigen::VectorXd r(2 * static_cast<Eigen::Index>(map.observations.size()));
    Eigen::Index row = 0;
    for (const CornerObservation& o : map.observations) {
      const auto frame = static_cast<Eigen::Index>(o.frame);
      const SE3 T = SE3::exp(delta.segment<6>(6 * (frame - 1))) * *map.frames[o.frame].T_cam_ref;
      const Corner& corner = map.corners[o.corner];
      const double inverse_depth =
          corner.inverse_depth + delta[poses + static_cast<Eigen::Index>(o.corner)];
      r.segment<2>(row) =
          camera.project(T * (camera.unproject(corner.pixel) / inverse_depth)) - o.pixel;
      row += 2;
    }
    return r;
  };
  const Eigen::MatrixXd J = numericJacobian(residuals, static_cast<int>(poses + corners));
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(J.transpose() * J);
  Eigen::VectorXd inverse = eigen.eigenvalues().cwiseInverse();
  inverse[0] = 0;  // the scale
  Eigen::VectorXd scale = eigen.eigenvectors().col(0);
  scale /= -scale.tail(corners).mean();
  Eigen::RowVectorXd mean = Eigen::RowVectorXd::Zero(poses + corners);
  mean.tail(corners).setConstant(1.0 / static_cast<double>(corners));
  const Eigen::MatrixXd to_gauge =
      Eigen::MatrixXd::Identity(poses + corners, poses + corners) + scale * mean;
  return to_gauge * eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose() *
         to_gauge.transpose();
}

TEST(GeometricCovariance, EqualsTheDensePseudoInverseInTheSameGauge) {
  SyntheticMap scene = makeSyntheticMap({60, 4, 0.2, 0}, 6);
  GeometricOptions options = huber();
  options.loss_threshold = 1000;  // the referee has no weights
  const auto factor = adjust(scene.start, scene.camera, options);
  ASSERT_TRUE(factor);
  setFormalCovariances(scene.start, scene.camera, options);
  const Eigen::MatrixXd expected = *factor * denseCovariance(scene.start, scene.camera);
  for (int k = 1; k < 4; ++k) {
    const Eigen::MatrixXd block = expected.block(6 * (k - 1), 6 * (k - 1), 6, 6);
    EXPECT_LT(
        relativeDifference(*scene.start.frames[static_cast<std::size_t>(k)].covariance, block),
        1e-5);
  }
  for (int i = 0; i < 60; ++i) {
    const double variance = scene.start.corners[static_cast<std::size_t>(i)].variance;
    EXPECT_NEAR(variance / expected(18 + i, 18 + i), 1.0, 1e-5) << i;
  }
}

/// Keeps the mean of all inverse depths: a gauge that Ceres can differentiate.
class FixedMean final : public ceres::CostFunction {
 public:
  FixedMean(std::size_t depths, double weight) : weight_(weight) {
    mutable_parameter_block_sizes()->assign(depths, 1);
    set_num_residuals(1);
  }
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    const std::size_t count = parameter_block_sizes().size();
    const double share = weight_ / static_cast<double>(count);
    residuals[0] = -weight_;
    for (std::size_t i = 0; i < count; ++i) {
      residuals[0] += share * *parameters[i];
      if (jacobians != nullptr && jacobians[i] != nullptr) jacobians[i][0] = share;
    }
    return true;
  }

 private:
  double weight_;
};

/// Covariances by sparse QR of the whole Jacobian (SuiteSparse), the mean inverse depth fixed.
class SparseQrReferee {
 public:
  SparseQrReferee(const InitialMap& map, const PinholeCamera& camera) {
    for (const PosedFrame& frame : map.frames) {
      poses_.push_back(published::toBlock(*frame.T_cam_ref));
    }
    std::vector<double*> depths;
    for (const Corner& corner : map.corners) {
      depths_.push_back(corner.inverse_depth);
      depths.push_back(&depths_.back());
    }
    for (const CornerObservation& o : map.observations) {
      const std::size_t corner = o.corner;
      const Eigen::Vector3d ray = camera.unproject(map.corners[corner].pixel);
      double* pose = poses_[o.frame].data();
      problem_.AddResidualBlock(
          new published::ReprojectionCost(camera, ray, o.pixel), nullptr, pose, depths[corner]);
    }
    for (std::size_t k = 1; k < poses_.size(); ++k) {
      published::setPoseManifold(problem_, poses_[k].data());
    }
    problem_.AddResidualBlock(new FixedMean(depths.size(), kStiff), nullptr, depths);
    ceres::Covariance::Options options;
    options.algorithm_type = ceres::SPARSE_QR;
    options.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
    covariance_ = std::make_unique<ceres::Covariance>(options);
    std::vector<std::pair<const double*, const double*>> wanted;
    for (std::size_t k = 1; k < poses_.size(); ++k)
      wanted.emplace_back(poses_[k].data(), poses_[k].data());
    for (const double* depth : depths) wanted.emplace_back(depth, depth);
    usable_ = covariance_->Compute(wanted, &problem_);
  }

  [[nodiscard]] bool usable() const { return usable_; }
  [[nodiscard]] Matrix6d pose(std::size_t frame) const {
    Eigen::Matrix<double, 6, 6, Eigen::RowMajor> block;
    const double* pose = poses_[frame].data();
    EXPECT_TRUE(covariance_->GetCovarianceBlockInTangentSpace(pose, pose, block.data()));
    return block;
  }
  [[nodiscard]] double depth(std::size_t corner) const {
    double variance = 0;
    EXPECT_TRUE(covariance_->GetCovarianceBlock(&depths_[corner], &depths_[corner], &variance));
    return variance;
  }

 private:
  static constexpr double kStiff =
      1e7;  // a variance of the mean far below those of the inverse depths
  std::vector<published::PoseBlock> poses_;
  std::deque<double> depths_;
  ceres::Problem problem_;
  std::unique_ptr<ceres::Covariance> covariance_;
  bool usable_ = false;
};

TEST(GeometricCovariance, EqualsSparseQrOfCeres) {
  SyntheticMap scene = makeSyntheticMap({200, 5, 0.2, 0}, 9);
  GeometricOptions options = huber();
  options.loss_threshold = 1000;  // the referee has no weights
  const auto factor = adjust(scene.start, scene.camera, options);
  ASSERT_TRUE(factor);
  setFormalCovariances(scene.start, scene.camera, options);
  ASSERT_EQ(scene.start.corners.size(), 200U);
  const SparseQrReferee referee(scene.start, scene.camera);
  ASSERT_TRUE(referee.usable());
  // Measured at most 2e-10, poses and depths; margin x5.
  for (std::size_t k = 1; k < scene.start.frames.size(); ++k) {
    const Matrix6d expected = *factor * referee.pose(k);
    EXPECT_LT(relativeDifference(*scene.start.frames[k].covariance, expected), 1e-9) << k;
  }
  for (std::size_t i = 0; i < 200; ++i) {
    const double expected = *factor * referee.depth(i);
    EXPECT_NEAR(scene.start.corners[i].variance / expected, 1, 1e-9) << i;
  }
}

/// Median over 30 maps of the squared error of the newest pose over its covariance, a sixth.
double medianPoseRatio(bool formal) {
  std::vector<double> ratios;
  for (std::uint64_t seed = 40; seed < 70; ++seed) {
    SyntheticMap scene = makeSyntheticMap({600, 4, 0.1, 0}, seed);
    addSharedErrors(scene, 0.3, seed);
    EXPECT_TRUE(adjust(scene.start, scene.camera, huber()));
    if (formal) setFormalCovariances(scene.start, scene.camera, huber());
    const Vector6d error =
        (*scene.truth.frames[3].T_cam_ref * scene.start.frames[3].T_cam_ref->inverse()).log();
    ratios.push_back(error.dot(scene.start.frames[3].covariance->inverse() * error) / 6);
  }
  return medianOf(ratios);
}

TEST(GeometricCovariance, ClusteredPredictsErrorsThatNeighboursShare) {
  EXPECT_GT(medianPoseRatio(true), 5);               // measured 9.7
  EXPECT_NEAR(medianPoseRatio(false), 0.891, 0.45);  // measured 1.17; expected 0.891
}

}  // namespace
}  // namespace dsorb::init_orb
