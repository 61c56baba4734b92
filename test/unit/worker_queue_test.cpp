// SPDX-License-Identifier: BSD-3-Clause
#include "base/worker_queue.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <stdexcept>
#include <thread>
#include <vector>

namespace dsorb {
namespace {

using Queue = WorkerQueue<int, int>;

std::vector<int> takeAll(Queue& queue) {
  std::vector<int> results;
  while (const std::optional<int> result = queue.take()) results.push_back(*result);
  return results;
}

/// With and without a thread.
class WorkerQueueTest : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(MaxWaiting, WorkerQueueTest, ::testing::Values(0, 1, 3));

TEST_P(WorkerQueueTest, WorksInTheOrderGiven) {
  Queue queue([](int job) { return 10 * job; }, GetParam());
  for (int i = 1; i <= 20; ++i) queue.submit(i);
  queue.wait();
  const std::vector<int> results = takeAll(queue);
  ASSERT_EQ(results.size(), 20U);
  for (int i = 1; i <= 20; ++i) EXPECT_EQ(results[static_cast<std::size_t>(i - 1)], 10 * i);
  EXPECT_FALSE(queue.busy());
}

TEST(WorkerQueue, WithoutAThreadTheResultIsThereAtOnce) {
  Queue queue([](int job) { return job + 1; }, 0);
  queue.submit(4);
  EXPECT_EQ(queue.take(), 5);
  EXPECT_EQ(queue.take(), std::nullopt);
}

TEST_P(WorkerQueueTest, AnExceptionIsTakenBehindTheResultsBeforeItAndOnce) {
  const auto work = [](int job) -> int {
    if (job == 2) throw std::runtime_error("work");
    return job;
  };
  Queue queue(work, GetParam());
  for (const int job : {1, 2, 3}) queue.submit(job);
  queue.wait();
  EXPECT_EQ(queue.take(), 1);
  EXPECT_THROW((void)queue.take(), std::runtime_error);
  EXPECT_EQ(queue.take(), std::nullopt) << "jobs behind the failed one are dropped";
  queue.submit(4);
  queue.wait();
  EXPECT_EQ(queue.take(), 4) << "it goes on afterwards";
}

/// Work that stands still until it may go on.
struct Gate {
  std::promise<void> opened;
  std::shared_future<void> open{opened.get_future()};
  std::atomic<int> begun{0};
  int operator()(int job) {
    ++begun;
    open.wait();
    return job;
  }
  void waitUntilBegun() const {
    while (begun == 0) std::this_thread::yield();
  }
};

TEST(WorkerQueue, SubmitWaitsWhileTheQueueIsFull) {
  Gate gate;
  Queue queue([&](int job) { return gate(job); }, 2);
  queue.submit(1);
  gate.waitUntilBegun();
  queue.submit(2);
  queue.submit(3);
  std::atomic<bool> is_in{false};
  std::thread fourth([&] {
    queue.submit(4);
    is_in = true;
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_FALSE(is_in) << "one under work, two waiting";
  gate.opened.set_value();
  fourth.join();
  queue.wait();
  EXPECT_EQ(takeAll(queue).size(), 4U);
}

TEST(WorkerQueue, DiscardDropsWhatWaitsAndAllResults) {
  Gate gate;
  Queue queue([&](int job) { return gate(job); }, 3);
  queue.submit(1);
  gate.waitUntilBegun();
  queue.submit(2);
  EXPECT_TRUE(queue.busy());
  std::thread opener([&] { gate.opened.set_value(); });
  queue.discard();
  opener.join();
  EXPECT_FALSE(queue.busy());
  EXPECT_EQ(queue.take(), std::nullopt);
  EXPECT_LE(gate.begun, 2) << "the second one only if the gate opened before discard()";
}

TEST(WorkerQueue, EndsWithTheJobUnderWork) {
  Gate gate;
  {
    Queue queue([&](int job) { return gate(job); }, 3);
    for (const int job : {1, 2, 3}) queue.submit(job);
    gate.waitUntilBegun();
    gate.opened.set_value();
  }
  EXPECT_LE(gate.begun, 3);
}

}  // namespace
}  // namespace dsorb
