// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/image/frame_priors.h"

#include "dsorb/image/frame.h"

#include "image/frame_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

constexpr int kPriorWidth = 32;
constexpr int kPriorHeight = 16;
constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

FramePtr frameWith(DepthPrior prior, int id = 0) {
  const std::vector<float> pixels(static_cast<std::size_t>(kPriorWidth) * kPriorHeight, 100);
  FrameInfo info{FrameId{id}, .1 * id};
  info.priors = std::make_shared<FramePriors>(FramePriors{std::move(prior)});
  return Frame::create({pixels.data(), kPriorWidth, kPriorHeight}, info);
}

std::vector<float> depths(float value) {
  return std::vector<float>(static_cast<std::size_t>(kPriorWidth) * kPriorHeight, value);
}

TEST(DenseDepth, HasBothPartsOfTheDeviationAndHoles) {
  std::vector<float> image = depths(2);
  image[1] = kUnknown;
  image[2] = 0;
  image[3] = -1;
  const DepthPrior prior = denseDepth({image.data(), kPriorWidth, kPriorHeight}, .03, .02);
  EXPECT_FLOAT_EQ(prior.sigma[0], .05F);
  EXPECT_EQ(prior.depth[0], 2);
  for (std::size_t i = 1; i <= 3; ++i) EXPECT_FALSE(prior.depth[i] > 0) << i;
  EXPECT_TRUE(prior.metric);
  EXPECT_THROW((void)denseDepth({image.data(), kPriorWidth, kPriorHeight}, 0, 0),
               std::invalid_argument);
  EXPECT_THROW((void)denseDepth({image.data(), kPriorWidth, kPriorHeight}, -1, 2),
               std::invalid_argument);
  EXPECT_THROW((void)denseDepth({}, 1, 0), std::invalid_argument);
}

TEST(SparseDepth, KeepsTheNearerOfTwoAndLeavesOutWhatIsOutside) {
  const DepthPrior prior = sparseDepth(
      kPriorWidth, kPriorHeight, {{3.4F, 2, 5, .1F}, {2.6F, 2.2F, 4, .2F}, {-3, 2, 1, .1F}});
  const std::size_t at = 2 * kPriorWidth + 3;
  EXPECT_EQ(prior.depth[at], 4);
  EXPECT_EQ(prior.sigma[at], .2F);
  int known = 0;
  for (const float depth : prior.depth) known += depth > 0 ? 1 : 0;
  EXPECT_EQ(known, 1);
  EXPECT_THROW((void)sparseDepth(kPriorWidth, kPriorHeight, {{1, 1, 0, .1F}}),
               std::invalid_argument);
  EXPECT_THROW((void)sparseDepth(kPriorWidth, kPriorHeight, {{1, 1, 2, 0}}), std::invalid_argument);
  EXPECT_THROW((void)sparseDepth(0, kPriorHeight, {}), std::invalid_argument);
  EXPECT_NO_THROW((void)sparseDepth(kPriorWidth, kPriorHeight, {{kUnknown, 1, 2, 1}}));  // nowhere
}

TEST(FrameCheck, RefusesPriorsOfAnotherSizeAndWithoutDeviationAndLeavesNoTrace) {
  const PinholeCamera camera{30, 30, 16, 8, kPriorWidth, kPriorHeight};
  FrameCheck check(camera);
  const std::vector<float> image = depths(2);
  const DepthPrior good = denseDepth({image.data(), kPriorWidth, kPriorHeight}, 0, .01);
  DepthPrior bad = good;
  bad.width = kPriorHeight;
  EXPECT_THROW(check.accept(frameWith(bad)), std::invalid_argument);
  bad = good;
  bad.depth.pop_back();
  EXPECT_THROW(check.accept(frameWith(bad)), std::invalid_argument);
  bad = good;
  bad.sigma[7] = 0;
  EXPECT_THROW(check.accept(frameWith(bad)), std::invalid_argument);
  bad.depth[7] = kUnknown;
  EXPECT_NO_THROW(check.accept(frameWith(bad)));
  EXPECT_NO_THROW(check.accept(frameWith(good, 1)));
}

TEST(PosePrior, IsOfARotationWithACovariance) {
  const Eigen::Matrix3d R = so3Exp({.1, .2, -.1}).toRotationMatrix();
  const PosePrior prior = rotationSince(FrameId{3}, R, .01);
  EXPECT_EQ(prior.since, FrameId{3});
  EXPECT_FALSE(prior.has_translation);
  EXPECT_LT((prior.T_frame_since.rotationMatrix() - R).norm(), 1e-12);
  EXPECT_NEAR(prior.covariance(4, 4), 1e-4, 1e-12);
  EXPECT_THROW((void)rotationSince(FrameId{3}, R, 0), std::invalid_argument);
  EXPECT_THROW((void)rotationSince(FrameId{3}, 2 * R, .01), std::invalid_argument);
  EXPECT_THROW((void)rotationSince(FrameId{3}, -R, .01), std::invalid_argument);
}

TEST(FrameCheck, RefusesPosePriorsWithoutAPositiveDefiniteCovariance) {
  const PinholeCamera camera{30, 30, 16, 8, kPriorWidth, kPriorHeight};
  FrameCheck check(camera);
  const auto frameKnowing = [](const PosePrior& pose) {
    const std::vector<float> image(static_cast<std::size_t>(kPriorWidth) * kPriorHeight, 100);
    auto priors = std::make_shared<FramePriors>();
    priors->pose = pose;
    FrameInfo info{FrameId{0}, 0};
    info.priors = priors;
    return Frame::create({image.data(), kPriorWidth, kPriorHeight}, info);
  };
  const SE3 moved(Eigen::Quaterniond::Identity(), {1, 0, 0});
  Matrix6d covariance = Matrix6d::Identity();
  covariance(1, 1) = -1;
  EXPECT_THROW(check.accept(frameKnowing(poseSince(FrameId{0}, moved, covariance))),
               std::invalid_argument);
  covariance(1, 1) = 1;
  covariance(0, 1) = .5;  // not symmetric
  EXPECT_THROW(check.accept(frameKnowing(poseSince(FrameId{0}, moved, covariance))),
               std::invalid_argument);
  covariance(1, 0) = .5;
  EXPECT_NO_THROW(check.accept(frameKnowing(poseSince(FrameId{0}, moved, covariance))));
}

}  // namespace
}  // namespace dsorb
