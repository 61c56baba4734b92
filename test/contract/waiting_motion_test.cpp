// SPDX-License-Identifier: BSD-3-Clause
// What `orb` says of the motion before it starts.
#include "dsorb/init/initializer.h"

#include "support/init_run.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include <cmath>

namespace dsorb {
namespace {

TEST(WaitingMotion, ComesWithACovarianceAndIsRight) {
  synthetic::SequenceOptions options;
  options.kind = synthetic::SequenceKind::kRoom;
  options.noise_sigma = 2;
  options.speed = 0.08;  // slow: the first attempts are not sure enough
  options.width = 320;
  options.height = 240;
  options.length = 40;
  const RenderedSequence& sequence = rendered(options);
  const auto initializer = makeInitializer({}, sequence.camera());
  const InitRun run = feed(*initializer, sequence.frames());
  ASSERT_TRUE(run.result) << run.log();
  int motions = 0;
  for (std::size_t i = 0; i < run.steps.size(); ++i) {
    const InitStep& step = run.steps[i];
    if (!step.motion) continue;
    ++motions;
    const WaitingMotion& motion = *step.motion;
    EXPECT_FALSE(step.result);
    EXPECT_LT(motion.reference.value, static_cast<int>(i));
    EXPECT_GE(motion.reference.value, 0);
    EXPECT_GT(motion.wrong_probability, 0);
    EXPECT_LE(motion.wrong_probability, 1);
    ASSERT_TRUE(motion.covariance);
    EXPECT_EQ(motion.covariance->llt().info(), Eigen::Success);
    const SE3 truth =
        sequence.pose(static_cast<int>(i)).inverse() * sequence.pose(motion.reference.value);
    const double cosine =
        motion.T_cam_ref.translation().normalized().dot(truth.translation().normalized());
    // Measured below 2.4 deg; wrong by more than 10 deg with these probabilities: .03 at most.
    EXPECT_GT(cosine, std::cos(10 * EIGEN_PI / 180)) << i;
  }
  EXPECT_GE(motions, 3) << run.log();  // measured 12
}

}  // namespace
}  // namespace dsorb
