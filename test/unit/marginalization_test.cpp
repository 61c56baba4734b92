// SPDX-License-Identifier: BSD-3-Clause
#include "window/marginalization.h"

#include "support/window_scene.h"
#include "window/normal_equations.h"
#include "window/window_step.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <vector>

namespace dsorb::window {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

TEST(EliminateLastTest, EqualsTheSchurComplement) {
  std::srand(4);  // Eigen's Random
  const MatrixXd A = MatrixXd::Random(40, 28);
  MarginalPrior prior{A.transpose() * A * 1e4, VectorXd::Random(28) * 1e3};
  const MarginalPrior rest = eliminateLast(prior, 8);
  const MatrixXd W = prior.H.bottomRightCorner(8, 8).ldlt().solve(prior.H.bottomLeftCorner(8, 20));
  const MatrixXd H = prior.H.topLeftCorner(20, 20) - prior.H.topRightCorner(20, 8) * W;
  const VectorXd b = prior.b.head(20) - W.transpose() * prior.b.tail(8);
  EXPECT_LT((rest.H - H).norm(), 1e-10 * H.norm());
  EXPECT_LT((rest.b - b).norm(), 1e-10 * b.norm());
}

TEST(EliminateLastTest, DirectionsWithoutInformationAreHarmless) {
  MarginalPrior prior{MatrixXd::Zero(12, 12), VectorXd::Zero(12)};
  prior.H(0, 0) = 5;
  prior.b[0] = 2;
  const MarginalPrior rest = eliminateLast(prior, 8);
  EXPECT_NEAR(rest.H(0, 0), 5, 1e-12);
  EXPECT_NEAR(rest.b[0], 2, 1e-12);
}

/// Frame of a camera whose rows take 20 ms.
FramePtr rollingFrame(int id) {
  const PinholeCamera camera{80, 80, 39.5, 29.5, 80, 60};
  Lens lens{LensModel::kPinhole, 80, 80, 39.5, 29.5, {}, 80, 60};
  lens.readout = {0.02, 0};
  FrameInfo info{FrameId{id}, 0.1 * id, 1, nullptr};
  info.row_times = std::make_shared<const RowTimes>(rowTimes(lens, camera, false));
  const std::vector<float> image(80UL * 60UL, 40);
  return Frame::create(ImageView(image.data(), 80, 60), info);
}

TEST(MarginalizeKeyframeTest, EliminatesTheVelocityOfARollingShutterWithItsPrior) {
  Window window(PinholeCamera{80, 80, 39.5, 29.5, 80, 60});
  const WindowOptions options;
  for (int k = 0; k < 3; ++k) {
    RowMotion found;
    found.velocity << 0.1, 0.2, 0.3, -0.1, -0.2, -0.3;
    MotionPrior expected{found, Vector6d::Constant(0.02)};
    expected.mean.velocity *= 0.9;
    addKeyframe(window, rollingFrame(k), SE3(), {}, options).setMotion(found, expected);
  }
  constexpr Index kState = kFrameDim + kVelocityDim;
  constexpr Index kRest = kCameraDim + 2 * kState;
  ASSERT_EQ(window.dimension(), kRest + kState);
  std::srand(5);  // Eigen's Random
  const MatrixXd A = 1e3 * MatrixXd::Random(80, kRest + kState);
  window.prior.H = A.transpose() * A;
  window.prior.b = 1e5 * VectorXd::Random(kRest + kState);
  const Keyframe& leaves = window.keyframes[1];
  MatrixXd H = window.prior.H;
  VectorXd b = window.prior.b;
  const Vector6d information = velocityInformation(window, leaves);
  H.diagonal().segment<kVelocityDim>(window.rowOf(1) + kFrameDim) += information;
  b.segment<kVelocityDim>(window.rowOf(1) + kFrameDim) +=
      information.cwiseProduct(0.1 * leaves.motion.velocity.cwiseQuotient(velocityScale()));
  Eigen::VectorXi order(H.rows());
  for (int i = 0; i < order.size(); ++i) order[i] = i;
  std::rotate(
      order.data() + window.rowOf(1), order.data() + window.rowOf(2), order.data() + order.size());
  H = MatrixXd(H(order, order));
  b = VectorXd(b(order));
  const MatrixXd W =
      H.bottomRightCorner<kState, kState>().ldlt().solve(H.bottomLeftCorner<kState, kRest>());
  const MatrixXd rest = H.topLeftCorner<kRest, kRest>() - H.topRightCorner<kRest, kState>() * W;
  const VectorXd gradient = b.head<kRest>() - W.transpose() * b.tail<kState>();
  const Keyframe gone = marginalizeKeyframe(window, 1, options);
  EXPECT_EQ(gone.frame->id(), FrameId{1});
  ASSERT_EQ(window.dimension(), kRest);
  EXPECT_LT((window.prior.H - rest).norm(), 1e-9 * rest.norm());
  EXPECT_LT((window.prior.b - gradient).norm(), 1e-9 * gradient.norm());
}

/// A window whose first keyframe hosts all points; they were seen often enough to be marginalised.
WindowScene leavingScene(const WindowOptions& options) {
  WindowSceneOptions scene_options;
  scene_options.cell = 20;
  scene_options.hosts = 1;
  scene_options.prior_variance = 4e-4F;
  WindowScene scene = makeWindowScene(scene_options, options);
  perturb(scene, 5e-4, 2);
  Keyframe& host = scene.window.keyframes[0];
  host.leaves = true;
  host.state.head<6>().setConstant(1e-5);  // away from its first estimate
  for (WindowPoint& point : host.points) {
    point.good_observations = 5;
    point.information = 1000;
  }
  return scene;
}

TEST(MarginalizationTest, APriorWithAWrongGuessIsForgotten) {
  WindowOptions options;
  options.optimizer.optimize_intrinsics = true;
  options.prior.focal_sigma = 0.15;
  Window window = leavingScene(options).window;
  forgetGuess(window, options);  // here it begins
  const auto filled = [&](double focal_change) {
    window.prior.H.setOnes();
    window.prior.b.setOnes();
    window.camera_state.head<2>().setConstant(focal_change * window.first_camera.fx / kCameraScale);
    forgetGuess(window, options);
    return !window.prior.H.isZero(0) && !window.prior.b.isZero(0);
  };
  EXPECT_TRUE(filled(0.009));
  EXPECT_EQ(window.forgotten, -1);
  EXPECT_FALSE(filled(0.011));
  EXPECT_EQ(window.forgotten, window.keyframes.back().id.value);
  EXPECT_TRUE(filled(0.019)) << "1 % from where it began anew";
  options.prior.focal_sigma = 0;
  EXPECT_TRUE(filled(0.5)) << "a calibration is no guess";
}

TEST(MarginalizationTest, PriorEqualsTheSchurComplementOfTheFullProblem) {
  WindowOptions options;
  options.prior.depth_at_marginalization = 1;
  WindowScene scene = leavingScene(options);
  Window& window = scene.window;

  LinearizeOptions linearize;
  linearize.frozen = true;
  NormalEquationsBuilder builder;
  WindowEquations full;
  builder.build(window, PairTable(window), allPoints(window), linearize, full);
  ASSERT_GT(full.used, 100);
  const Index frames = window.dimension();
  const auto points = static_cast<Index>(full.points());
  MatrixXd H = MatrixXd::Zero(frames + points, frames + points);
  H.topLeftCorner(frames, frames) = full.H;
  VectorXd b(frames + points);
  b.head(frames) = full.b;
  for (Index i = 0; i < points; ++i) {
    const auto point = static_cast<std::size_t>(i);
    H.col(frames + i).head(frames) = full.couplingOf(point).cast<double>();
    H.row(frames + i).head(frames) = H.col(frames + i).head(frames).transpose();
    H(frames + i, frames + i) =
        full.known(point) ? static_cast<double>(full.depth_hessian[point]) : 1;
    b[frames + i] = static_cast<double>(full.depth_gradient[point]);
  }
  H *= kMarginalizationWeight;
  b *= kMarginalizationWeight;
  H.diagonal().segment<8>(kCameraDim) += window.keyframes[0].prior;
  b.segment<8>(kCameraDim) += window.keyframes[0].prior.cwiseProduct(window.keyframes[0].first);
  // Keep the other three keyframes; eliminate keyframe 0 and all depths together.
  const Index kept = 24;
  Eigen::VectorXi order(frames + points);
  for (Index i = 0; i < kept; ++i) order[i] = static_cast<int>(kCameraDim + 8 + i);
  for (Index i = 0; i < 8; ++i) order[kept + i] = static_cast<int>(kCameraDim + i);
  for (Index i = 0; i < points; ++i) order[kept + 8 + i] = static_cast<int>(frames + i);
  const Eigen::VectorXi used = order.head(kept + 8 + points);
  const VectorXd scale = H.diagonal()(used).cwiseSqrt();
  const MatrixXd sorted = scale.cwiseInverse().asDiagonal() * MatrixXd(H(used, used)) *
                          scale.cwiseInverse().asDiagonal();
  const VectorXd sorted_b = b(used).cwiseQuotient(scale);
  const Index gone = 8 + points;
  const MatrixXd W =
      sorted.bottomRightCorner(gone, gone).ldlt().solve(sorted.bottomLeftCorner(gone, kept));
  const auto undo = scale.head(kept).asDiagonal();
  const MatrixXd expected_H =
      undo * (sorted.topLeftCorner(kept, kept) - sorted.topRightCorner(kept, gone) * W) * undo;
  const VectorXd expected_b = undo * (sorted_b.head(kept) - W.transpose() * sorted_b.tail(gone));

  retirePoints(window, options);
  const std::vector<Keyframe> gone_keyframes = marginalizeFlagged(window, options);
  ASSERT_EQ(gone_keyframes.size(), 1U);
  EXPECT_EQ(static_cast<Index>(gone_keyframes[0].marginalized.size()), points);
  EXPECT_EQ(window.keyframes.size(), 3U);
  const MatrixXd H_prior = window.prior.H.bottomRightCorner(kept, kept);
  EXPECT_LT((H_prior - expected_H).norm(), 1e-8 * expected_H.norm());
  EXPECT_LT((window.prior.b.tail(kept) - expected_b).norm(), 1e-8 * expected_b.norm());
  EXPECT_EQ((window.prior.H - window.prior.H.transpose()).norm(), 0);
}

TEST(MarginalizationTest, RemainingResidualsFollowTheShiftedPositions) {
  const WindowOptions options;
  WindowSceneOptions scene_options;
  scene_options.cell = 40;
  WindowScene scene = makeWindowScene(scene_options, options);
  Window& window = scene.window;
  const KeyframeId second = window.keyframes[1].id;
  window.keyframes[0].leaves = window.keyframes[1].leaves = true;
  retirePoints(window, options);
  const std::vector<Keyframe> gone = marginalizeFlagged(window, options);
  ASSERT_EQ(gone.size(), 2U);  // the first and the second in one go
  EXPECT_EQ(gone[1].id, second);
  EXPECT_EQ(window.prior.b.size(), window.dimension());
  ASSERT_FALSE(window.keyframes[0].points.empty());
  for (const WindowPoint& point : window.keyframes[0].points) {
    ASSERT_EQ(point.num_observations, 1);
    EXPECT_EQ(point.begin()->target, 1);
  }
}

TEST(MarginalizationTest, AKeyframeWithPointsIsRefused) {
  const WindowOptions options;
  WindowSceneOptions scene_options;
  scene_options.cell = 60;
  WindowScene scene = makeWindowScene(scene_options, options);
  EXPECT_THROW(marginalizeKeyframe(scene.window, 0, options), std::logic_error);
}

/// Three keyframes without images and a point with residuals to both others.
struct Judged {
  Judged() : window(PinholeCamera{100, 100, 50, 50, 100, 100}) {
    for (int i = 0; i < 5; ++i) {
      window.keyframes.emplace_back();
      window.keyframes.back().id = {i};
    }
    for (std::size_t k = 1; k < 5; ++k) point.addObservation(k);
    point.inverse_depth = 1;
    point.good_observations = 5;
    point.information = 100;
    point.recent = {RecentState{{4}, ResidualState::kIn}, RecentState{{3}, ResidualState::kIn}};
  }
  [[nodiscard]] PointVerdict verdict(bool host_leaves = false) const {
    return judgePoint(point, host_leaves, window);
  }
  Window window;
  WindowPoint point;
};

TEST(JudgePointTest, PointsStayWhileTheNewestKeyframeSeesThem) {
  Judged judged;
  EXPECT_EQ(judged.verdict(), PointVerdict::kStay);
  judged.point.recent[0].state = ResidualState::kOutlier;
  EXPECT_EQ(judged.verdict(), PointVerdict::kStay);
  judged.point.recent[1].state = ResidualState::kOutlier;
  EXPECT_EQ(judged.verdict(), PointVerdict::kMarginalize);
  judged.point.recent[0].state = ResidualState::kOutOfBounds;
  EXPECT_EQ(judged.verdict(), PointVerdict::kMarginalize);
}

TEST(JudgePointTest, OnlyWellObservedPointsKeepTheirInformation) {
  Judged judged;
  EXPECT_EQ(judged.verdict(true), PointVerdict::kMarginalize);
  judged.point.information = 50;
  EXPECT_EQ(judged.verdict(true), PointVerdict::kDiscard);
  judged.point.information = 100;
  judged.point.good_observations = 3;
  EXPECT_EQ(judged.verdict(true), PointVerdict::kDiscard);
  judged.point.good_observations = 5;
  judged.point.num_observations = 2;
  EXPECT_EQ(judged.verdict(true), PointVerdict::kDiscard);
}

TEST(JudgePointTest, ImpossibleDepthsAndUnseenPointsAreDiscarded) {
  Judged judged;
  judged.point.inverse_depth = -0.01F;
  EXPECT_EQ(judged.verdict(), PointVerdict::kDiscard);
  judged.point.inverse_depth = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(judged.verdict(), PointVerdict::kDiscard);
  judged.point.inverse_depth = 1;
  judged.point.num_observations = 0;
  EXPECT_EQ(judged.verdict(), PointVerdict::kDiscard);
}

TEST(JudgePointTest, OldPointsLeaveBeforeTooFewResidualsRemain) {
  Judged judged;
  judged.window.keyframes[1].leaves = judged.window.keyframes[2].leaves = true;
  EXPECT_EQ(judged.verdict(), PointVerdict::kStay);
  judged.point.good_observations = 15;
  EXPECT_EQ(judged.verdict(), PointVerdict::kMarginalize);
}

}  // namespace
}  // namespace dsorb::window
