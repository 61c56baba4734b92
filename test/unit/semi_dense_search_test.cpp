// SPDX-License-Identifier: BSD-3-Clause
// One pixel's search along its epipolar line, as semi-dense depth uses it.
#include "base/median.h"
#include "estimate/warp.h"
#include "init/orb/semi_dense/epipolar_search.h"
#include "support/plane_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

namespace dsorb::init_orb {
namespace {

TEST(EpipolarLine, PositionAndDepthInvertEachOther) {
  const PlaneScene scene(1);
  const EpipolarGeometry geometry(scene.camera(), poseOf(0.1, -0.05, 0.15, 0.04));
  const auto line = EpipolarLine::through(geometry, {60, 180}, 0.8F);
  ASSERT_TRUE(line.has_value());
  for (const float inverse_depth : {0.1F, 0.5F, 0.8F, 1.5F}) {
    const std::optional<float> position = line->positionOf(inverse_depth);
    ASSERT_TRUE(position.has_value());
    EXPECT_NEAR(line->depthAt(*position).inverse_depth, inverse_depth, 1e-4F);
  }
  EXPECT_NEAR(*line->positionOf(0.8F), 0, 1e-4F);
  EXPECT_GT(*line->positionOf(1.0F), 0);
}

TEST(EpipolarLine, DerivativesMatchCentralDifferences) {
  const PlaneScene scene(1);
  const SE3 T = poseOf(0.1, -0.05, 0.15, 0.04);
  const EpipolarGeometry geometry(scene.camera(), T);
  const Eigen::Vector2d pixel(60, 180);
  const auto project = [&](const Eigen::Vector2d& at, double inverse_depth) {
    return scene.camera().project(T * (scene.camera().unproject(at) / inverse_depth));
  };
  const auto line = EpipolarLine::through(geometry, pixel.cast<float>(), 0.8F);
  ASSERT_TRUE(line.has_value());
  const double h = 1e-5;
  const Eigen::Vector2d velocity = (project(pixel, 0.8 + h) - project(pixel, 0.8 - h)) / (2 * h);
  EXPECT_NEAR(line->speed() / velocity.norm(), 1, 1e-4);
  EXPECT_NEAR(line->direction().cast<double>().dot(velocity.normalized()), 1, 1e-6);
  EXPECT_LT((line->origin().cast<double>() - project(pixel, 0.8)).norm(), 1e-3);
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector2d step = Eigen::Vector2d::Unit(axis) * 1e-3;
    const Eigen::Vector2d column = (project(pixel + step, 0.8) - project(pixel - step, 0.8)) / 2e-3;
    EXPECT_LT((line->warp().col(axis).cast<double>() - column).norm(), 1e-4);
  }
  // alpha, away from the origin: positions of two inverse depths close together.
  const double at = *line->positionOf(1.2F);
  const double moved = (project(pixel, 1.2 + h) - project(pixel, 1.2 - h)).norm() / (2 * h);
  EXPECT_NEAR(line->depthAt(static_cast<float>(at)).alpha * moved, 1, 1e-3);
}

TEST(EpipolarLine, HasNoDirectionAtTheEpipoleOrWithoutTranslation) {
  const PlaneScene scene(1);
  const Eigen::Vector2f centre(159.5F, 119.5F);
  const EpipolarGeometry forward(scene.camera(), poseOf(0, 0, 0.2, 0));
  EXPECT_FALSE(EpipolarLine::through(forward, centre, 1.0F).has_value());
  const EpipolarGeometry turned(scene.camera(), poseOf(0, 0, 0, 0.1));
  EXPECT_FALSE(EpipolarLine::through(turned, {40, 40}, 1.0F).has_value());
}

TEST(EpipolarSearch, GeometricVarianceIsTheSpreadUnderDrawnPoses) {
  const PlaneScene scene(5);
  const SE3 truth = poseOf(0.08, 0.03, 0.05, 0.02);
  const FramePtr reference = scene.render(SE3(), 0, 0);
  const FramePtr target = scene.render(truth, 0, 1);
  const double sigma = 0.3;  // of a pixel's place in the target, the same in every direction [px]
  SemiDenseOptions options;
  options.image_noise = 1e-3;  // the geometric part alone
  std::vector<double> ratios;
  for (int y = 30; y < 210; y += 20) {
    for (int x = 30; x < 290; x += 20) {
      const double rho = scene.inverseDepth({x, y});
      // The smallest motions of the camera that displace this pixel along x and y.
      const auto projection = projectHosted(
          scene.camera(), truth, scene.camera().unproject(Eigen::Vector2d(x, y)), rho);
      ASSERT_TRUE(projection.has_value());
      const Eigen::Matrix<double, 2, 6> J = projection->J_pose;
      const Eigen::Matrix<double, 6, 2> motion = J.transpose() * (J * J.transpose()).inverse();
      const Matrix6d covariance = sigma * sigma * motion * motion.transpose();
      Random random(static_cast<std::uint64_t>(1000 * y + x));
      double squares = 0;
      double predicted = 0;
      int found = 0;
      for (int draw = 0; draw < 60; ++draw) {
        Eigen::Vector2d displacement;
        for (int d = 0; d < 2; ++d) displacement[d] = sigma * random.gaussian();
        const Vector6d xi = motion * displacement;
        const SearchFrame frame{target, SE3::exp(xi) * truth, covariance, {}};
        const EpipolarSearch search(reference, frame, scene.camera(), options);
        EpipolarSearch::Scratch scratch;
        const SearchOutcome outcome =
            search.search({Eigen::Vector2f(static_cast<float>(x), static_cast<float>(y)),
                           static_cast<float>(rho),
                           0.01F},
                          scratch);
        if (outcome.status == SearchStatus::kFound) {
          squares += std::pow(outcome.observation.inverse_depth - rho, 2);
          predicted += outcome.observation.variance;
          ++found;
        }
      }
      if (found > 55) ratios.push_back(squares / predicted);
    }
  }
  ASSERT_GT(ratios.size(), 20U);
  EXPECT_NEAR(medianOf(ratios), 1.0, 0.15);  // measured 1.04; 60 draws of 6 components
}

TEST(EpipolarSearch, SkipsGradientsAcrossTheLineAndPixelsThatLeaveTheImage) {
  // Horizontal stripes: the gradient is vertical.
  std::vector<float> grey;
  for (int y = 0; y < 240; ++y) {
    for (int x = 0; x < 320; ++x) {
      grey.push_back(static_cast<float>(128 + 60 * std::sin(0.4 * y)));
    }
  }
  const FramePtr frame = Frame::create(ImageView(grey.data(), 320, 240), {FrameId{0}});
  const PinholeCamera camera = PlaneScene(1).camera();
  const SemiDenseOptions options;
  EpipolarSearch::Scratch scratch;
  const SemiDensePoint prior{{160, 110}, 1.0F, 0.04F};
  const SearchFrame right{frame, poseOf(0.1, 0, 0, 0), Matrix6d::Zero(), {}};
  EXPECT_EQ(EpipolarSearch(frame, right, camera, options).search(prior, scratch).status,
            SearchStatus::kSkipped);
  const SearchFrame down{frame, poseOf(0, 0.1, 0, 0), Matrix6d::Zero(), {}};
  EXPECT_NE(EpipolarSearch(frame, down, camera, options).search(prior, scratch).status,
            SearchStatus::kSkipped);
  const SearchFrame away{frame, poseOf(0, 3, 0, 0), Matrix6d::Zero(), {}};
  EXPECT_EQ(EpipolarSearch(frame, away, camera, options).search(prior, scratch).status,
            SearchStatus::kSkipped);
}

TEST(EpipolarSearch, SkipsPixelsWhoseRowHasNoTime) {
  const PlaneScene scene(1);
  const FramePtr frame = scene.render(SE3(), 0, 0);
  RowTimes times;
  times.readout.seconds = 0.03;
  times.share[6] = std::numeric_limits<float>::max();  // as a polynomial far outside of the image
  times.width = frame->width();
  times.height = frame->height();
  RowMotion motion;
  motion.velocity[0] = 1;
  SearchFrame right{frame, poseOf(0.1, 0, 0, 0), Matrix6d::Zero(), {}};
  right.shutter = makeRollingShutter(times, motion);
  const SemiDenseOptions options;
  const EpipolarSearch search(frame, right, scene.camera(), options);
  EpipolarSearch::Scratch scratch;
  for (float x = 20; x < 300; x += 7) {
    EXPECT_NE(search.search({{x, 110}, 1.0F, 0.04F}, scratch).status, SearchStatus::kFound);
  }
}

TEST(EpipolarSearch, RejectsRepeatedTexture) {
  std::vector<float> grey;
  for (int y = 0; y < 240; ++y) {
    for (int x = 0; x < 320; ++x) {
      grey.push_back(static_cast<float>(128 + 60 * std::sin(2 * M_PI * x / 12)));  // 12 px period
    }
  }
  const FramePtr frame = Frame::create(ImageView(grey.data(), 320, 240), {FrameId{0}});
  const PinholeCamera camera = PlaneScene(1).camera();
  const SemiDenseOptions options;
  const SearchFrame right{frame, poseOf(0.2, 0, 0, 0), Matrix6d::Zero(), {}};
  EpipolarSearch::Scratch scratch;
  const EpipolarSearch search(frame, right, camera, options);
  // 40 px per unit of inverse depth: +-0.8 covers five periods, +-0.08 less than one.
  EXPECT_EQ(search.search({{156, 110}, 0.9F, 0.16F}, scratch).status, SearchStatus::kRejected);
  EXPECT_EQ(search.search({{156, 110}, 0.9F, 0.0016F}, scratch).status, SearchStatus::kFound);
}

}  // namespace
}  // namespace dsorb::init_orb
